"""Stage 2: video and first boxes become image tracks."""

from pipeline.tracking.detection.contact_sheet import contact_sheet
from pipeline.tracking.detection.propose import Proposal, propose_targets
from pipeline.tracking.following.overlay import overlay_frame, overlay_frames, write_overlay
from pipeline.tracking.following.track import track_video
from pipeline.tracking.records import VideoTimes, VideoTracks
from pipeline.tracking.scene.turning import ImageTurning, image_turning
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.video.frames import indexed_times, video_head, video_times
from pipeline.tracking.video.reader import FrameReader

__all__ = [
    "FrameReader",
    "ImageTurning",
    "Proposal",
    "TrackingSettings",
    "VideoTimes",
    "VideoTracks",
    "contact_sheet",
    "image_turning",
    "indexed_times",
    "overlay_frame",
    "overlay_frames",
    "propose_targets",
    "track_video",
    "video_head",
    "video_times",
    "write_overlay",
]
