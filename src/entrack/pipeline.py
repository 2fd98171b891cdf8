"""Work beside the main thread, in order: decode ahead of it, draw and encode behind it.

PyAV, OpenCV and the inference engines release the GIL, so plain threads overlap. An exception of a
thread is raised in the main thread.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, ParamSpec, Self, TypeVar, cast

T = TypeVar("T")
P = ParamSpec("P")
_DEPTH = 4  # rides out a slow frame; each place holds one picture
_BYTES = 64_000_000  # of pictures that wait


def room(size: int, depth: int) -> int:
    """How many things of `size` bytes may wait, at most `depth`.

    >>> room(1920 * 1080 * 3, 4), room(3840 * 2160 * 3, 4), room(7680 * 4320 * 3, 4)
    (4, 2, 0)
    """
    return min(depth, _BYTES // max(1, size))


def ahead(
    items: Iterable[T], depth: int = _DEPTH, weigh: Callable[[T], int] = lambda item: 0
) -> Generator[T, None, None]:
    """Yield `items` unchanged while a thread computes up to `depth` of them in advance.

    Fewer of them where they are large: `weigh` says the bytes of each.

    >>> list(ahead(range(3)))
    [0, 1, 2]
    """
    iterator, end = iter(items), object()
    with ThreadPoolExecutor(1, "ahead") as pool:
        waiting = deque([pool.submit(next, iterator, end)])
        try:
            while (item := waiting.popleft().result()) is not end:
                while len(waiting) < room(weigh(cast(T, item)), depth):
                    waiting.append(pool.submit(next, iterator, end))
                yield cast(T, item)
                del item  # not to be kept while the next one is made
                if not waiting:
                    waiting.append(pool.submit(next, iterator, end))
        finally:
            for future in waiting:
                future.cancel()


class Behind(Generic[P]):
    """Call `work` in a thread, in order; a call waits only when `depth` others are unfinished.

    An exception of `work` is raised by one of the next calls, or on leaving the `with` block.

    Parameters
    ----------
    weigh
        Says of the arguments of a call how many bytes they hold; fewer large ones wait.

    >>> seen = []
    >>> with Behind(seen.append) as later:
    ...     later(1)
    ...     later(2)
    >>> seen
    [1, 2]
    """

    def __init__(
        self,
        work: Callable[P, object],
        depth: int = _DEPTH,
        weigh: Callable[P, int] = lambda *args, **kwargs: 0,
    ) -> None:
        self._work, self._depth, self._weigh = work, depth, weigh
        self._pool = ThreadPoolExecutor(1, "behind")
        self._waiting: deque[Future[object]] = deque()

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Have `work` called with these arguments."""
        self._waiting.append(self._pool.submit(self._work, *args, **kwargs))
        while len(self._waiting) > room(self._weigh(*args, **kwargs), self._depth):
            self._waiting.popleft().result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True)
        for future in self._waiting:
            future.result()
