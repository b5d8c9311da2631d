"""The files that fuzzing starts from are whole: each is read, else nothing behind its head would be reached."""

import pytest

from scripts.validation.check_fuzzing import KINDS
from scripts.validation.fuzzed_inputs import reader, seeds


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_fuzzed_is_read(kind, tmp_path):
    files, read = seeds(kind), reader(kind, tmp_path)
    assert files
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        found = read(tmp_path / name)
        if kind == "label":
            assert found.startswith(b"HTTP/1.1 200"), name
        if kind == "video":
            times, pictures, log = found
            assert times.frames == 5, name
            assert all(picture is not None for picture in pictures), name
            assert (getattr(log, "format", "") == "dji srt") == (name == "b.mkv")
    if kind == "label":
        read.close()
