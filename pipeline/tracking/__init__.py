"""Stage 2: video and first boxes become image tracks."""

from typing import TYPE_CHECKING

from calibration.foundation.on_demand import on_demand

if TYPE_CHECKING:
    from pipeline.tracking.detection.contact_sheet import contact_sheet
    from pipeline.tracking.detection.propose import Proposal, propose_targets
    from pipeline.tracking.following.overlay import overlay_frame, overlay_frames, write_overlay
    from pipeline.tracking.following.track import track_video
    from pipeline.tracking.records import VideoTimes, VideoTracks
    from pipeline.tracking.scene.turning import ImageTurning, image_turning
    from pipeline.tracking.settings import TrackingSettings
    from pipeline.tracking.video.frames import indexed_times, video_head, video_times
    from pipeline.tracking.video.reader import FrameReader
else:
    __getattr__ = on_demand(
        __name__,
        {
            "FrameReader": "video.reader",
            "ImageTurning": "scene.turning",
            "Proposal": "detection.propose",
            "TrackingSettings": "settings",
            "VideoTimes": "records",
            "VideoTracks": "records",
            "contact_sheet": "detection.contact_sheet",
            "image_turning": "scene.turning",
            "indexed_times": "video.frames",
            "overlay_frame": "following.overlay",
            "overlay_frames": "following.overlay",
            "propose_targets": "detection.propose",
            "track_video": "following.track",
            "video_head": "video.frames",
            "video_times": "video.frames",
            "write_overlay": "following.overlay",
        },
    )

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
