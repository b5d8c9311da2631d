"""Which flights names, patterns, folders and tables stand for, and what they are called."""

import pandas as pd
import pytest

from calibration.foundation.errors import InputFileError, UsageError
from pipeline.batch import find_flights


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "flight.toml").write_text("")
    (tmp_path / "night.toml").write_text("")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sources(*given):
    return [flight.source for flight in find_flights(given)]


def test_a_file_a_folder_and_a_pattern(folder):
    a, b = (str(folder / name / "flight.toml") for name in "ab")
    assert sources("a/flight.toml") == [a]
    assert sources("b") == [b]
    assert sources("*/flight.toml") == [a, b]
    assert sources("?") == [a, b]
    assert sources("b", "*/flight.toml") == [b, a], "each once, where it came first"
    assert sources(f"file://{b}") == [b]


def test_a_name_depends_on_the_flight_alone(folder):
    alone, (first, _) = find_flights(["a"]), find_flights(["a", "night.toml"])
    assert alone[0].name == first.name
    assert first.name.startswith("a-")
    assert find_flights(["night.toml"])[0].name.startswith("night-")


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_table_lies_beside_its_flights_and_may_name_them(folder, kind):
    table = pd.DataFrame({"flight": ["a/flight.toml", "b/flight.toml"], "name": ["first", ""]})
    getattr(table, f"to_{kind}")(folder / f"flights.{kind}", index=False)
    first, second = find_flights([f"flights.{kind}"])
    assert (first.name, first.source) == ("first", str(folder / "a" / "flight.toml"))
    assert second.name.startswith("b-")


@pytest.mark.parametrize(
    ("text", "words"),
    [("where\na\n", "no column `flight`"), ('flight\n"a\n', "cannot be read"), ("flight\n", "no flight file")],
)
def test_a_table_that_is_none(folder, text, words):
    (folder / "flights.csv").write_text(text)
    with pytest.raises((InputFileError, UsageError), match=words):
        find_flights(["flights.csv"])


@pytest.mark.parametrize("name", ["../up", "a b", ".hidden", "x" * 101])
def test_a_name_that_names_no_folder_is_refused(folder, name):
    pd.DataFrame({"flight": ["a"], "name": [name]}).to_csv("flights.csv")
    with pytest.raises(UsageError, match="it names a folder"):
        find_flights(["flights.csv"])


def test_one_name_for_two_flights_is_refused(folder):
    pd.DataFrame({"flight": ["a", "b"], "name": ["x", "X"]}).to_csv("flights.csv")
    with pytest.raises(UsageError, match=r"X, which .*a has too"):
        find_flights(["flights.csv"])


def test_what_matches_nothing_is_said(folder):
    with pytest.raises(InputFileError, match="nothing matches"):
        find_flights(["c*/flight.toml"])


@pytest.mark.parametrize("url", ["nowhere://x/flight*.toml", "simplecache::file:///x/*.toml", "memory://*"])
def test_urls_that_lead_nowhere(url):
    with pytest.raises((UsageError, InputFileError)):
        find_flights([url])
