"""The command `vot`, with one defect of vot-toolkit 0.9 mended.

    python -m entrack.interop.vot_supervised evaluate --workspace DIR entrack

In release 0.9 the supervised experiment, that of the challenges until 2019, hands one object to
runtimes that take a list and expects one back, so that it fails for every tracker.
"""

from typing import Any

from entrack.errors import require


def mend() -> None:
    """Let supervised experiments give and take the one object of a list."""
    experiment: Any = require("vot.experiment.multirun", "vot").SupervisedExperiment
    original = experiment._get_runtime

    def get_runtime(self: Any, *args: Any, **kwargs: Any) -> Any:
        runtime = original(self, *args, **kwargs)
        initialize, update = runtime.initialize, runtime.update

        def initialize_one(frame: Any, new: Any) -> tuple[Any, float]:
            [status], seconds = initialize(frame, [new])
            return status, seconds

        def update_one(frame: Any) -> tuple[Any, float]:
            [status], seconds = update(frame, [])
            return status, seconds

        runtime.initialize, runtime.update = initialize_one, update_one
        return runtime

    experiment._get_runtime = get_runtime


if __name__ == "__main__":
    mend()
    require("vot.__main__", "vot").main()
