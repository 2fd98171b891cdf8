"""Pictures in and out: videos, folders, cameras and streams as frames, and frames as a video."""

from entrack.video.clip import Clip
from entrack.video.opening import open_source
from entrack.video.source import Frame, Source
from entrack.video.writer import VideoWriter, written_size

__all__ = ["Clip", "Frame", "Source", "VideoWriter", "open_source", "written_size"]
