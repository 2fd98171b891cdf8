"""The one exception that a caller can cause, and the check for optional extras."""

import importlib
from types import ModuleType


class EntrackError(ValueError):
    """Something that the caller can put right: one sentence with what was found and expected."""


def require(module: str, extra: str) -> ModuleType:
    """Import `module`, or say which extra of entrack installs it.

    >>> require("math", "train").pi
    3.14159
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        message = f"this needs {package}, which is not installed: pip install 'entrack[{extra}]'"
        raise EntrackError(message) from error
