"""Stage 2: video and first boxes become image tracks."""

from pipeline.tracking.overlay import overlay_frame, overlay_frames, write_overlay
from pipeline.tracking.records import VideoTimes, VideoTracks
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.track import track_video
from pipeline.tracking.turning import ImageTurning, image_turning
from pipeline.tracking.video import video_times

__all__ = [
    "ImageTurning",
    "TrackingSettings",
    "VideoTimes",
    "VideoTracks",
    "image_turning",
    "overlay_frame",
    "overlay_frames",
    "track_video",
    "video_times",
    "write_overlay",
]
