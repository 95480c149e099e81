"""YAML files: numbers of YAML 1.2, no duplicate key, no document beyond a limit; parts for versions of the manual."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from eos_ref import InputError
from eos_ref.syntax.manual import FIRST, MANUALS
from lammps_cases.records import yaml_files
from lammps_cases.records.yaml_files import FlowText, OfManual, compose, flow, position, read_yaml, yaml_text


def _written(folder: Path, text: str) -> Path:
    (folder / "one.yaml").write_text(text, encoding="utf-8")
    return folder / "one.yaml"


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("[1e-12, 1E5, -2.5e+3, .5e1, 1.e2]", [1e-12, 1e5, -2500.0, 5.0, 100.0]),
        ("[1, -2, 0.5, .inf, true, null, '1e5', on]", [1, -2, 0.5, float("inf"), True, None, "1e5", True]),
        ("a: {b: [x, 'y z']}\nc: 2", {"a": {"b": ["x", "y z"]}, "c": 2}),
        ("a: &k [1]\nb: *k", {"a": [1], "b": [1]}),
        ("", None),
    ],
)
def test_values_read(tmp_path: Path, text: str, data: Any) -> None:
    assert read_yaml(_written(tmp_path, text)) == data


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("a: 1\nb: 2\na: 3", r"thing: is not valid YAML: repeated key 'a' \(.*one.yaml, line 3, column 1\)"),
        ("? [1]\n: 2", r"a key must be a plain word .*line 1, column 3"),
        ("a: [1", "is not valid YAML: .*line 2, column 1"),
        ("a:\n\tb: 1", r"is not valid YAML: tabs do not indent, spaces do \(.*line 2, column 1\)"),
        ("a: @b", r"is not valid YAML: found character that cannot start any token \(.*line 1, column 4\)"),
        ("b: *k\na: &k 1", r"an alias must come after what it stands for .*line 1, column 4"),
        ("a: " + "[" * 41 + "]" * 41, "must be at most 40 levels deep"),
        ("a: " + "1" * 401, "a number must have at most 400 digits"),
        ("a: !!python/object:os.system {}", "could not determine a constructor"),
        ("a: !!float x", "is not valid YAML"),
    ],
)
def test_refusals(tmp_path: Path, text: str, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        read_yaml(_written(tmp_path, text), "thing")


def test_aliases_are_counted_expanded(tmp_path: Path) -> None:
    """Ten times ten times ...: six lines of ten expand to a million parts."""
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 6)]
    assert len(read_yaml(_written(tmp_path, "\n".join(lines[:4])))["a3"]) == 10
    with pytest.raises(InputError, match=f"aliases must stand for at most {yaml_files.MOST_ALIASED} parts"):
        read_yaml(_written(tmp_path, "\n".join(lines)))


PLAIN = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text("abe15.:-#{}[]'\"& \n+yn~", max_size=6)
)
LIKE_OTHERS = st.sampled_from(["1e5", "1E-3", ".5e1", "-2.5e+3", "true", "null", ".inf"])  # texts
WORDS = st.text("abenoy15", min_size=1, max_size=4)


@given(
    st.recursive(
        PLAIN | LIKE_OTHERS, lambda part: st.lists(part, max_size=3) | st.dictionaries(WORDS, part, max_size=3)
    )
)
def test_whatever_is_written_is_read_back(data: Any) -> None:
    """Texts that look like numbers stay texts, and the other way round."""
    with TemporaryDirectory() as folder:
        assert repr(read_yaml(_written(Path(folder), yaml_text(data)))) == repr(data)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "null"),
        (True, "true"),
        ([1, 2.5], "[1, 2.5]"),
        ({"b": None, "a": ["1e5"]}, "{b: null, a: ['1e5']}"),
        ([7] * 60, f"[{'7, ' * 26}7 ..."),
        ("null", "'null'"),
        (1.5, "1.5"),
    ],
)
def test_values_in_complaints(value: Any, shown: str) -> None:
    assert repr(flow(value)) == shown
    assert isinstance(flow(value), FlowText) == (not isinstance(value, str | float) or value is True)


def test_places_count_from_1(tmp_path: Path) -> None:
    assert position(0, 4) == "line 1, column 5"
    node = compose(_written(tmp_path, "a: 1\nb: [x, y]"))
    _, value = node.value[1]
    assert [(each.start_mark.line, each.start_mark.column) for each in value.value] == [(1, 4), (1, 7)]


def test_statement_holds_from_its_first_to_its_last_manual() -> None:
    newest = MANUALS[-1]
    assert len(MANUALS) > 1 and all(OfManual().made_in(manual) for manual in MANUALS)
    for since, until, holds in ((FIRST, FIRST, [1, 0]), (newest, newest, [0, 1]), (FIRST, newest, [1, 1])):
        assert [OfManual(since=since, until=until).made_in(manual) for manual in (FIRST, newest)] == holds
    with pytest.raises(ValidationError, match="since must not be later than until"):
        OfManual(since=newest, until=FIRST)
    with pytest.raises(ValidationError, match="since"):
        OfManual(since="1995.1.1")
