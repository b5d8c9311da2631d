"""MISB ST 0601 metadata in an MPEG transport stream: the video and where its camera was, in one file.

The few items that a pose needs are read here: the one Python library (klvdata, never past its version 0.0.0) takes
error values for angles and the height of full range for text, and reads no transport streams.
"""
