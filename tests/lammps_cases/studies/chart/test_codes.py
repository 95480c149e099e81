"""Comparison of whole codes: PySPH's answers are read, its errors measured as ours; a note replaces it if absent."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.analytic import waves
from lammps_cases.report.pages.figures import BLUE, RED
from lammps_cases.studies.chart import codes, page, record
from lammps_cases.studies.chart.codes import COMPARED, SWIRL, by_pysph
from lammps_cases.studies.chart.record import Chart, Section
from lammps_cases.studies.flows import periodic
from lammps_cases.studies.flows.record import LAMMPS, REFERENCE, FlowRecord
from tests.support.outcome import Outcome
from tests.support.roundings import HALF_EPS, rounded
from tests.workshop import tables_codes, tables_validation

Run = Callable[..., Outcome]
N = 8
VORTICES, CAVITY, RECONSTRUCTED, DAM, DROP = COMPARED


def python(folder: Path, code: str) -> str:
    """Return a program that stands in for a Python with PySPH."""
    path = folder / "python"
    path.write_text(f"#!{sys.executable}\nimport json, sys\n{code}\n")
    path.chmod(0o755)
    return str(path)


def answering(folder: Path, shots: list[dict[str, object]]) -> str:
    """Return one that prints its version, or the given shots as the particles of any flow."""
    (folder / "shots.json").write_text(json.dumps({"particles": 80, "steps": 9, "seconds": 1.5, "shots": shots}))
    (folder / "version.json").write_text('{"version": "9"}')
    chosen = "('version' if sys.argv[1] == '-c' else 'shots')"
    return python(folder, f"print('noise')\nprint(open({str(folder)!r} + '/' + {chosen} + '.json').read())")


def vortices(factor: float) -> dict[str, object]:
    """Return the final solution, too fast by a factor, in PySPH's units: edge and largest velocity are 1."""
    x_n, y_n = (a.ravel() for a in np.meshgrid(*[(np.arange(N) + 0.5) / N] * 2))
    time = codes.REYNOLDS / (8 * np.pi**2)
    u_n, v_n, _ = waves.taylor_green(x_n, y_n, time, 2 * np.pi, 1 / codes.REYNOLDS, factor)
    return {"time": time, **{name: a.tolist() for name, a in zip("xyuv", (x_n, y_n, u_n, v_n), strict=True)}}


# --- errors


@pytest.mark.parametrize("factor", [1.0, 1.25])
def test_error_of_vortices_is_that_of_their_speed(tmp_path: Path, factor: float) -> None:
    start = SWIRL.start(N, SWIRL.options)
    result = by_pysph(answering(tmp_path, [vortices(factor)]), VORTICES, "tvf", N, start)
    assert (result.n, result.steps, result.seconds, result.message) == (80, 9, 1.5, "")
    assert result.snapshots[0].time == rounded(1 / (2 * periodic.wave_number(N) ** 2), 12)
    errors = SWIRL.measures(N, SWIRL.options, result.snapshots)
    # Only rounding remains, on either side: three in each of two phases up to 2 pi, 12 of the time to which they
    # belong, 10 of sines and cosines, their product and its units.
    left = 2 * (2 * 3 * 2 * np.pi + 12 + 10) * HALF_EPS
    assert errors["profile"] == pytest.approx(factor - 1, rel=0, abs=left)
    assert errors["rate"] == pytest.approx(np.log(factor), rel=0, abs=left)


@pytest.mark.parametrize("case", [CAVITY, DAM, DROP], ids=lambda case: case.flow.name)
def test_front_and_line_profile_are_measured_as_ours(tmp_path: Path, case: codes.Compared) -> None:
    """Initial particles in PySPH's format have the same errors as in ours."""
    start = case.flow.start(N, case.flow.options)
    wet_n = start.atoms.type_n == 1
    x_nc, v_nc = start.atoms.x_nc[wet_n, :2], np.full((wet_n.sum(), 2), 0.3)
    values = dict(zip("xyuv", (*(x_nc / N).T.tolist(), *v_nc.T.tolist()), strict=True))
    unit = N / case.speed(N)
    shots: list[dict[str, object]] = [{"time": step * start.timestep / unit, **values} for step in start.steps]
    result = by_pysph(answering(tmp_path, shots), case, "edac", N, start)
    exact = [replace(shot, x_nc=start.atoms.x_nc[:, :2]) for shot in result.snapshots]
    errors = [case.flow.measures(N, case.flow.options, of)[case.measure] for of in (result.snapshots, exact)]
    assert errors[0] == rounded(errors[1], 4, terms=2.0 * N)
    assert 0.1 < errors[0] < 10


def test_bad_answers_of_pysph(tmp_path: Path) -> None:
    start = SWIRL.start(N, SWIRL.options)
    result = by_pysph(answering(tmp_path, [vortices(1.0) | {"x": [np.nan] * N**2}]), VORTICES, "tvf", N, start)
    assert result.message == "a position of PySPH is no finite number"
    other = tmp_path / "other"
    other.mkdir()
    shot = {"time": 1.0, "x": [0.0], "y": [0.0], "u": [0.0], "v": [0.0]}
    with pytest.raises(InputError, match="PySPH: must have 64 particles of fluid, found 1"):
        by_pysph(answering(other, [shot]), VORTICES, "tvf", N, start)


def test_omitted_options_leave_the_vortices_unchanged() -> None:
    """Without its options the flow is that of the other sections; the Mach number is at most 0.1."""
    plain, swirl = periodic.VORTICES.start(16, periodic.VORTICES.options), SWIRL.start(16, SWIRL.options)
    assert (plain.atoms.x_nc[:, :2] % 1 == 0.5).all()
    assert plain.case.scene.types[0].cs == 2.0
    moved = np.abs((swirl.atoms.x_nc - plain.atoms.x_nc)[:, :2])
    assert 0.09 < moved.max() <= 0.1
    assert swirl.case.scene.types[0].cs == 10 * codes.REYNOLDS / 16


# --- a Python without PySPH


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (None, "cannot be run: No such file"),
        ("sys.exit('No module named pysph')", "cannot run its example: No module named pysph"),
        ("sys.exit(3)", "cannot run its example: no message"),
        ("", "must print a JSON document in its last line"),
        ("print('done')", "must print a JSON document in its last line"),
        ("print([1])", "must print a JSON document in its last line"),
        ("import time; time.sleep(9)", "must answer within 0.5 s"),
    ],
)
def test_failing_peer_is_reported_in_one_line(tmp_path: Path, code: str | None, words: str) -> None:
    named = str(tmp_path / "nowhere") if code is None else python(tmp_path, code)
    with pytest.raises(InputError, match=f"Python of PySPH: {words}") as caught:
        codes.pysph_answer(named, "script.py", limit=0.5 if code and "sleep" in code else 600.0)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("codes", "--pysph", "/nowhere/python"), "Python of PySPH: cannot be run"),
        (("laws", "--pysph", "python"), "--pysph: must come with the section codes, found 'python'"),
    ],
)
def test_command_refuses_before_measuring(
    eos_ref_command: Run, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    ended = eos_ref_command("chart", *options, "--out", tmp_path / "out")
    assert ended.code == 2
    assert words in ended.err
    assert not (tmp_path / "out").exists()


# --- the whole path


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("with_pysph", [True, False])
def test_page_and_terminal_show_all_codes(
    eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, with_pysph: bool
) -> None:
    monkeypatch.setattr(codes, "COMPARED", (replace(VORTICES, flow=replace(SWIRL, quick=(N,))),))
    peer = ("--pysph", answering(tmp_path, [vortices(1.25)])) if with_pysph else ()
    ended = eos_ref_command("chart", "codes", "--quick", *peer, "--out", tmp_path / "out")
    assert ended.code == 0, ended.err
    chart = record.DOCUMENT.read(tmp_path / "out" / "chart.json")
    sides = [REFERENCE, LAMMPS, *(["PySPH tvf", "PySPH edac"] if with_pysph else [])]
    assert [run.side for run in chart.sections[0].codes] == sides
    assert all(run.seconds > 0 and run.steps > 0 for run in chart.sections[0].codes)
    html = (tmp_path / "out" / "report.html").read_text()
    assert ("--pysph PYTHON names a Python that has it" in html) is not with_pysph
    assert ("--pysph PYTHON names a Python that has it" in ended.out) is not with_pysph
    assert (chart.engine.get("pysph") == "9") is with_pysph
    assert f"{SWIRL.name} profile  LAMMPS " in ended.out
    table = (tmp_path / "out" / "errors.csv").read_text()
    assert (f"{SWIRL.name},PySPH tvf,profile,{N},0.2" in table) is with_pysph


# --- pictures and the document


def made(code: str, errors: tuple[float, ...]) -> list[FlowRecord]:
    """The runs of a code at N = 8 and 16; without errors it lost atoms."""
    sizes = zip((8, 16), (64, 256), (0.5, 4.0), errors or (None, None), strict=True)
    return [
        FlowRecord(SWIRL.name, code, n, particles, 9, seconds, "", {}, {VORTICES.measure: error}, {})
        if error is not None
        else FlowRecord(SWIRL.name, code, n, particles, 9, seconds, "Lost atoms", {}, {}, {})
        for n, particles, seconds, error in sizes
    ]


def test_code_has_one_colour_and_stopped_runs_no_point() -> None:
    of = {REFERENCE: (0.1, 0.05), LAMMPS: (), "PySPH tvf": (0.2, 0.1), "PySPH edac": (0.3, 0.1)}
    runs = [run for code, errors in of.items() for run in made(code, errors)]
    figure = page.codes_figure(runs)
    [axis] = figure.axes
    lines = {line.get_marker(): (line.get_color(), list(line.get_ydata())) for line in axis.lines}
    assert (lines["o"], lines["*"]) == ((BLUE, [0.1, 0.05]), (RED, []))
    assert lines["s"] == (lines["^"][0], [0.2, 0.1])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(of)
    [sound] = page.codes_figure(made(LAMMPS, (0.1, 0.05))).axes
    assert [line.get_color() for line in sound.lines] == [RED]
    assert [row[-1] for row in codes.rows(runs)][2:4] == ["Lost atoms", "Lost atoms"]


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        (
            {REFERENCE: (0.1, 0.05), LAMMPS: (0.2, 0.07), "PySPH tvf": ()},
            "an error of 0.07 takes reference 4 s, LAMMPS 4 s; the least error is that of reference, 0.05 in 4 s; "
            "PySPH tvf stops at every N.",
        ),
        (
            {REFERENCE: (0.1, 0.05), LAMMPS: (0.2, 0.11)},
            "an error of 0.11 takes reference 0.5 s, LAMMPS 4 s; the least error is that of reference, 0.05 in 4 s.",
        ),
        (  # the same error to one per cent: the faster one
            {REFERENCE: (0.1, np.nan), LAMMPS: (0.2, 0.0999)},
            "an error of 0.1 takes reference 0.5 s, LAMMPS 4 s; the least error is that of reference, 0.1 in 0.5 s.",
        ),
        ({LAMMPS: ()}, "no code solves it."),
    ],
)
def test_sentence_compares_seconds_at_an_error_that_all_reach(errors: dict[str, tuple[float, ...]], words: str) -> None:
    runs = {code: made(code, of) for code, of in errors.items()}
    assert codes.recommendation(VORTICES, runs) == f"{SWIRL.title}: {words}"


def test_saved_document_has_only_codes_and_no_paths() -> None:
    section = Section("codes", "", "", 2.0, codes=(*made(REFERENCE, (0.1, 0.05)), *made("PySPH tvf", (0.2, 0.1))))
    engine = {"distribution": "1", "library": "/here/liblammps.so", "pysph": "9"}
    command = "eos-ref chart --pysph /here/python --out /here"
    chart = Chart(command, {"processor": "p"}, engine, False, 9.0, (Section("laws", "", "", 7.0), section))
    kept = tables_codes.kept(chart)
    assert (kept.command, kept.sections, kept.seconds) == ("eos-ref chart codes --pysph PYTHON", (section,), 2.0)
    assert kept.engine == {"distribution": "1", "pysph": "9"}
    assert "| taylor-green-100, profile | PySPH tvf | 8: 0.2 in 0.5 s; 16: 0.1 in 4 s | 256, 9 |" in tables_codes.table(
        kept
    )
    assert "--pysph PYTHON names a Python" in tables_codes.table(
        tables_codes.kept(replace(chart, engine={"distribution": "1"}))
    )


def test_document_has_the_measured_table() -> None:
    path = Path(__file__).parents[4] / "docs" / "accuracy.md"
    text = path.read_text(encoding="utf-8")
    assert tables_validation.placed(text, tables_codes.table(record.DOCUMENT.read(tables_codes.MEASURED))) == text
