"""Telemetry in subtitles (.srt): DJI's dialects."""
