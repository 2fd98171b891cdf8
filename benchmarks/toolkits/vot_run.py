"""Run vot-toolkit's supervised experiment; runs in the toolkit's own environment.

    python vot_run.py evaluate --workspace WORKSPACE --experiments baseline TRACKER

Takes the arguments of `vot`. In release 0.9.0 the supervised experiment hands one object to
runtimes that expect a list, and expects one back; the protocol "traxsingle" stands between them.
"""

from vot.__main__ import main
from vot.tracker import register_runtime_protocol
from vot.tracker.trax import TraxTrackerRuntime


class SingleObject(TraxTrackerRuntime):
    """TraX with one object in and one object out."""

    def initialize(self, frame, new=None, properties=None):  # noqa: D102
        status, seconds = super().initialize(frame, [new], properties)
        return status[0], seconds

    def update(self, frame, new=None, properties=None):  # noqa: D102
        status, seconds = super().update(frame, [], properties)
        return status[0], seconds


register_runtime_protocol("traxsingle", SingleObject)
main()
