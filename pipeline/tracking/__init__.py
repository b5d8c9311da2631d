"""Stage 2: video and first boxes become image tracks."""

from pipeline.tracking.contact import contact_sheet
from pipeline.tracking.overlay import overlay_frame, overlay_frames, write_overlay
from pipeline.tracking.propose import Proposal, propose_targets
from pipeline.tracking.reader import FrameReader
from pipeline.tracking.records import VideoTimes, VideoTracks
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.track import track_video
from pipeline.tracking.turning import ImageTurning, image_turning
from pipeline.tracking.video import video_head, video_times

__all__ = [
    "FrameReader",
    "ImageTurning",
    "Proposal",
    "TrackingSettings",
    "VideoTimes",
    "VideoTracks",
    "contact_sheet",
    "image_turning",
    "overlay_frame",
    "overlay_frames",
    "propose_targets",
    "track_video",
    "video_head",
    "video_times",
    "write_overlay",
]
