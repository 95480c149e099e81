"""A run divided into shards."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref import InputError
from lammps_cases.records.run_record import RunRecord
from lammps_cases.run.shards import Costs, balanced, check_complete, divided, part_of
from lammps_cases.scene import casefile
from tests.support import made_runs
from tests.support.outcome import Outcome

COST = st.sampled_from([0.0, 1.0, 2.5]) | st.floats(0, 1e4)  # many costs are equal, or too small to measure
SECONDS = st.dictionaries(st.text("abc", min_size=1, max_size=4), COST, min_size=1, max_size=20)


@settings(max_examples=50, deadline=None)
@given(SECONDS, st.integers(1, 12), st.randoms())
def test_shards_are_a_balanced_partition_in_any_order(
    seconds: dict[str, float], count: int, chance: random.Random
) -> None:
    shards = balanced(seconds, count)
    assert sorted(name for shard in shards for name in shard) == sorted(seconds)
    mixed = list(seconds.items())
    chance.shuffle(mixed)
    assert balanced(dict(mixed), count) == shards
    busy = [sum(seconds[name] for name in sorted(shard)) for shard in shards]
    # The case that ends last went to the shard with the least work, at most the mean of the other cases' work.
    latest = sum(seconds.values()) / count + max(seconds.values()) * (1 - 1 / count)
    assert max(busy) <= latest * (1 + 1e-12 * len(seconds))
    assert sum(bool(shard) for shard in shards) == min(count, len(seconds)), "no shard is left without a case"


def test_shards_of_measured_cases_are_equally_long() -> None:
    """The longest case is alone, whereas every n-th case would give its shard the most."""
    cases = casefile.select(casefile.load(), ["near-rho0"])
    names = [case.name for case in cases]
    costs = Costs(seconds={names[0]: len(names) - 2.0} | dict.fromkeys(names[1:-1], 1.0))
    assert costs.of(names)[names[-1]] == 1.0, "never measured: the median of the others"
    parts = [part_of(cases, f"{k}/2", costs) for k in (1, 2)]
    assert [len(part) for part in parts] in ([1, len(names) - 1], [2, len(names) - 2])
    assert sorted(case.name for part in parts for case in part) == names
    assert len(part_of(cases, "1/2")) == (len(names) + 1) // 2


def test_shards_of_different_divisions_are_not_merged() -> None:
    cases = [made_runs.case("a"), made_runs.case("b"), made_runs.case("c")]
    whole = divided(["c", "a", "b"])

    def shard(part: str, *chosen: int, of: str = whole) -> RunRecord:
        record = made_runs.run(cases=[cases[k] for k in chosen])
        record.shard, record.divided = part, of
        return record

    check_complete([shard("2/2", 2), shard("1/2", 0, 1)])
    check_complete([shard("2/2", 2, of=""), shard("1/2", 0, of="")])  # of a version that did not record it
    for parts, complaint in (
        ([shard("2/2", 2), shard("1/2", 0)], "divided otherwise"),
        ([shard("2/2", 2), shard("1/2", 0, 1, of="x")], "divided otherwise"),
        ([shard("2/3", 2)], "missing 1/3, 3/3"),
        ([shard("2/999999", 2)], "missing 1/999999, 3/999999"),
    ):
        with pytest.raises(InputError, match=complaint) as told:
            check_complete(parts)
        assert len(str(told.value)) < 2000


def test_bad_shards_are_refused() -> None:
    for text in ("", "x", "0/2", "3/2", "1/1e9", "1/2/3", "-1/2", "1/1000000", "²/3"):
        with pytest.raises(InputError, match="must be i/n"):
            part_of([], text)
    with pytest.raises(InputError, match="is empty: there are 0 cases"):
        part_of([], "1/1")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{}", "schema: must be eos-ref/costs/1"),
        ('{"schema": "eos-ref/costs/1", "seconds": {"a": -1}}', "seconds.a: "),
        ('{"schema": "eos-ref/costs/1", "seconds": {"a": NaN}}', "seconds.a: "),
        ('{"schema": "eos-ref/costs/1", "seconds": {"a": 1e999}}', "seconds.a: "),
        ("seconds", "document: "),
        ('{"schema": "eos-ref/costs/1", "seconds": {}}', ""),
    ],
)
def test_bad_costs_are_refused_before_the_run(
    text: str, complaint: str, eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    file, words = tmp_path / "costs.json", ["--shard", "1/2"] if complaint else []
    file.write_text(text)
    code, out, err = eos_ref_command("run", "ranges", *words, "--costs", file, "--out", tmp_path / "report")
    assert (code, out) == (2, "") and complaint in err and err.count("\n") == 1
    assert complaint or err == "eos-ref: --costs: needs --shard, which it divides\n"
    assert not (tmp_path / "report").exists()
