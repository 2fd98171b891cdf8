"""Threads beside the main one: order, limits, errors, ends."""

import threading
import time
from collections.abc import Iterator
from contextlib import closing

import pytest

from entrack.pipeline import Behind, ahead


def counted(n: int, made: list[int], fail_at: int | None = None) -> Iterator[int]:
    for i in range(n):
        if i == fail_at:
            raise RuntimeError(f"item {i}")
        made.append(i)
        yield i


def settled(made: list[int]) -> int:
    """How many were made once nothing moves any more."""
    before = -1
    while len(made) != before:
        before = len(made)
        time.sleep(0.05)
    return before


def test_ahead_works_in_advance_but_not_without_limit() -> None:
    made: list[int] = []
    with closing(ahead(counted(100, made), depth=3)) as items:
        assert next(items) == 0
        assert 2 <= settled(made) <= 4
        assert list(items) == list(range(1, 100))


def test_large_things_are_not_made_in_advance_and_do_not_wait() -> None:
    def weigh(i: int) -> int:
        return 7680 * 4320 * 3

    made: list[int] = []
    with closing(ahead(counted(100, made), weigh=weigh)) as items:
        for count in (1, 2, 3):
            next(items)
            assert settled(made) == count
    seen: list[int] = []
    with Behind(seen.append, weigh=weigh) as later:
        later(1)
        assert seen == [1]


def test_ahead_raises_an_error_in_its_place() -> None:
    items, seen = ahead(counted(10, [], fail_at=5), depth=3), []
    with pytest.raises(RuntimeError, match="item 5"):
        for item in items:
            seen.append(item)
    assert seen == [0, 1, 2, 3, 4]


def test_ahead_stops_its_thread_when_it_is_left() -> None:
    threads = threading.active_count()
    made: list[int] = []
    with closing(ahead(counted(10**9, made))) as items:
        next(items)
    done = len(made)
    assert threading.active_count() == threads
    assert settled(made) == done


def test_behind_works_in_another_thread_in_order_and_finishes_on_exit() -> None:
    seen: list[tuple[int, str]] = []

    def work(i: int) -> None:
        time.sleep(0.001)
        seen.append((i, threading.current_thread().name))

    with Behind(work) as later:
        for i in range(20):
            later(i)
    assert [i for i, _ in seen] == list(range(20))
    assert threading.current_thread().name not in {name for _, name in seen}


def test_behind_makes_the_caller_wait_when_it_is_too_far_behind() -> None:
    gate, entered = threading.Event(), []

    def call() -> None:
        with Behind(lambda i: gate.wait(5), depth=2) as later:
            for i in range(4):
                later(i)
                entered.append(i)

    thread = threading.Thread(target=call)
    thread.start()
    assert settled(entered) == 2
    gate.set()
    thread.join(5)
    assert entered == [0, 1, 2, 3]


@pytest.mark.parametrize("calls", [1, 50])
def test_behind_raises_the_error_of_its_work(calls: int) -> None:
    def work(i: int) -> None:
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk full"), Behind(work) as later:
        for i in range(calls):
            later(i)
