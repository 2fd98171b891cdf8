"""Units of work in processes that fail, die and are stopped."""

import multiprocessing
import os
import time

import stub_trackers
from entrack.evaluation.pool import run_units


def events(numbers, workers):
    return list(run_units(stub_trackers.square, numbers, workers))


def test_every_unit_is_done_once_whatever_the_number_of_workers():
    for workers in (1, 2):
        found = events([1, 2, 3, 4], workers)
        assert sorted((e.unit, e.value) for e in found if e.kind == "done") == [
            (0, 1), (1, 4), (2, 9), (3, 16),
        ]  # fmt: skip
        assert {e.value for e in found if e.kind == "progress"} == {1, 2, 3, 4}


def test_a_unit_that_fails_is_reported_and_the_others_go_on():
    found = events([7, 2], 1)
    (failed,) = [e for e in found if e.kind == "failed"]
    assert failed.unit == 0
    assert failed.value.startswith("ValueError: seven\n")
    assert [e.value for e in found if e.kind == "done"] == [4]


def test_a_unit_that_kills_its_worker_three_times_is_given_up():
    found = events([13, 2, 3], 2)
    assert [e.unit for e in found if e.kind == "again"] == [0, 0]
    (failed,) = [e for e in found if e.kind == "failed"]
    assert failed.value == "its worker was killed by SIGKILL, 3 times"
    assert sorted(e.value for e in found if e.kind == "done") == [4, 9]


def test_closing_ends_the_workers():
    work = run_units(stub_trackers.square, [1, 2, 3], 2)
    next(work)
    work.close()
    time.sleep(0.1)
    assert not multiprocessing.active_children()


def test_who_has_other_work_is_not_kept_waiting():
    pauses = [0.0]  # the worker has not even started then; afterwards there is time
    pause = lambda: pauses.pop() if pauses else None  # noqa: E731
    first, *others = run_units(stub_trackers.square, [2, 3], 1, pause=pause)
    assert first.kind == "nothing"
    assert [e.value for e in others if e.kind == "done"] == [4, 9]
    assert "nothing" not in {e.kind for e in others}


def test_workers_have_the_threads_that_were_asked_for():
    before = os.environ.get("OMP_NUM_THREADS")
    (event,) = run_units(stub_trackers.threads, [0], 1, threads=3)
    assert event.value == "3"
    assert os.environ.get("OMP_NUM_THREADS") == before
