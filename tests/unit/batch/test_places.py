"""Places elsewhere: what does not answer is told, what is none is refused, nothing is a fault of the program."""

import pytest

from calibration.foundation.errors import InputFileError, UsageError
from pipeline.batch.places import check_place, file_system

fsspec = pytest.importorskip("fsspec")


def test_a_place_that_does_not_answer(monkeypatch):
    def refused(url):
        raise ConnectionRefusedError(111, "Connection refused")

    monkeypatch.setattr(fsspec.core, "url_to_fs", refused)
    with pytest.raises(InputFileError, match="Connection refused"):
        file_system("ftp://127.0.0.1:9/x")


def test_protocols_that_are_none():
    with pytest.raises(UsageError, match="a chain of protocols"):
        file_system("zip://a::http://127.0.0.1:9/x.zip")
    with pytest.raises(UsageError, match="fsspec knows"):
        file_system("nonsense://x")


@pytest.mark.parametrize("out", ["s3://", "s3:///", "file://"])
def test_a_protocol_without_a_place(out):
    with pytest.raises(UsageError, match="no place"):
        check_place(out)


def test_places_that_are_some():
    check_place("s3://bucket/batch")
    check_place("batch/")
