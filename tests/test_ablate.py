"""`entrack ablate`: grids of training runs, their scores, and what is made of them."""

from pathlib import Path

import numpy as np
import pytest

from entrack.config import PolicyConfig
from entrack.errors import EntrackError

pytest.importorskip("torch")
pytest.importorskip("gymnasium")
pytest.importorskip("matplotlib")

from entrack.cli.app import main
from entrack.learn.ablate import read_curves, read_scores
from entrack.learn.grids import GRIDS, cells, changed, scaled
from entrack.learn.train import preset
from entrack.report.ablation import bootstrap, summarise
from entrack.report.published import reference_tables
from test_train import TINY, clips  # noqa: F401


def test_the_alpha_grid_is_the_papers_table_4():
    grid = GRIDS["alpha"]
    assert list(grid.cells) == ["0", "0.1", "0.2", "0.3", "0.5", "0.7", "0.9"]
    [table] = [t for t in reference_tables() if t.name == "paper-table-4"]
    printed = {v for line in table.lines for cell in line.cells for v in [cell.value]}
    assert set(grid.published.values()) <= printed
    alphas = [c.sac.alpha for c in cells("alpha", preset("default")).values()]
    assert alphas == [0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9]


@pytest.mark.parametrize("base", ["default", "paper"])
@pytest.mark.parametrize("name", GRIDS)
def test_cells_of_every_grid_are_configurations_and_differ(name: str, base: str):
    config = preset(base)
    if name == "warmstart" and config.warm is None:
        with pytest.raises(EntrackError, match=r"no \[warm\]"):
            cells(name, config)
        return
    made = cells(name, config)
    assert all(list(made.values()).count(c) == 1 for c in made.values())
    assert GRIDS[name].reference in made
    if base == "paper":
        assert list(made) == list(GRIDS[name].cells)


def test_a_cell_changes_only_what_it_names():
    config = preset("default")
    other = changed(config, {"sac.alpha": 0.7, "tracker.policy.reach": 1.25})
    assert isinstance(other.tracker.policy, PolicyConfig)
    assert (other.sac.alpha, other.tracker.policy.reach) == (0.7, 1.25)
    assert changed(other, {"sac.alpha": config.sac.alpha, "tracker.policy.reach": 1.5}) == config
    with pytest.raises(EntrackError, match=r"sac\.gamma"):
        changed(config, {"sac.gamma": 2})


def test_a_scaled_run_is_shorter_and_nothing_else():
    config = preset("default")
    small = scaled(config, 0.1)
    assert (small.rounds, small.bank.looks, small.data.made) == (3, 8000, 16)
    assert small.warm and small.warm.steps == 250
    assert scaled(config, 1) == config
    assert scaled(changed(config, {"rounds": 0}), 0.1).rounds == 0


def test_differences_are_paired_and_certain_where_every_sequence_agrees():
    rng = np.random.default_rng(0)
    hard = rng.random(30)
    low = {s: {str(k): float(v) for k, v in enumerate(hard)} for s in range(3)}
    high = {s: {k: v + 0.1 for k, v in row.items()} for s, row in low.items()}
    a, b = summarise({"low": low, "high": high}, ["low", "high", "not run"], "low")
    assert a.difference is None
    assert b.difference == pytest.approx(0.1)
    assert b.difference_interval == pytest.approx((0.1, 0.1))
    assert b.interval[1] - b.interval[0] > 0.1


def test_the_interval_is_as_wide_as_theory_says():
    """Of seeds that agree it is that of the sequences: ± 1.96 standard errors."""
    values = np.random.default_rng(1).normal(0, 1, 100)
    low, high = bootstrap(np.stack([values] * 3))
    assert (high - low) / 2 == pytest.approx(1.96 * values.std() / 10, rel=0.1)


def test_seeds_widen_the_interval():
    same = np.tile(np.linspace(0, 1, 20), (3, 1))
    apart = same + np.array([[-0.3], [0.0], [0.3]])
    assert np.ptp(bootstrap(apart)) > 1.5 * np.ptp(bootstrap(same))


def test_a_grid_is_trained_scored_and_resumed(
    clips: Path,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    config = tmp_path / "tiny.toml"
    config.write_text(TINY)
    out = tmp_path / "out"
    words = ["ablate", "alpha", "--config", str(config), "--data", f"folder:{clips}"]
    words += ["--out", str(out), "--workers", "1"]
    assert main([*words, "--cell", "0", "--seeds", "1"]) == 0
    assert {name: list(seeds) for name, seeds in read_scores(out).items()} == {"0": [0]}
    before = (out / "cells" / "0" / "seed-0" / "score.json").stat().st_mtime_ns
    capsys.readouterr()
    assert main([*words, "--cell", "0.2"]) == 1
    assert "add --resume" in capsys.readouterr().err

    assert main([*words, "--cell", "0", "0.2", "--seeds", "1", "--resume"]) == 0
    assert (out / "cells" / "0" / "seed-0" / "score.json").stat().st_mtime_ns == before
    said = capsys.readouterr()
    rows = [line.split(" | ") for line in said.out.splitlines() if line.startswith("| 0")]
    assert [(row[0], row[5], row[6].strip("* |")) for row in rows] == [
        ("| 0", "1", "0.610"),
        ("| 0.2", "1", "0.655"),
    ]
    assert "no two frames" in said.err  # the clip that never shows its target
    for ending in "md", "csv", "tex", "svg", "png":
        assert (out / f"ablation.{ending}").stat().st_size > 100
    assert [list(seeds[0]) for seeds in read_curves(out).values()] == [[0, 1], [0, 1]]
    assert (out / "curves.png").stat().st_size > 100
    capsys.readouterr()
    assert main([*words, "--config", "paper", "--resume"]) == 1
    assert "another configuration" in capsys.readouterr().err


def test_wrong_calls_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = ["--data", "folder:none", "--out", str(tmp_path / "out")]
    assert main(["ablate", "colour", *words]) == 2
    assert "there are alpha, critic, inputs" in capsys.readouterr().err
    assert main(["ablate", "alpha", "--cell", "2", *words]) == 2
    assert "it has 0, 0.1, 0.2" in capsys.readouterr().err
    assert main(["ablate", "warmstart", "--config", "paper", *words]) == 2
    assert "no [warm]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
