"""OpenCV writes of every driver and target that it tries in vain; here it writes errors alone."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import cv2

_ERRORS = 2
"""OpenCV's level at which warnings are left out."""


@contextmanager
def errors_alone() -> Generator[None, None, None]:
    """Meanwhile OpenCV writes errors, and no warnings."""
    here: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging  # since 4.13
    before = here.setLogLevel(_ERRORS)
    try:
        yield
    finally:
        here.setLogLevel(before)
