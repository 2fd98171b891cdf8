"""Training a trunk: folding, the filter in torch, labels of pairs, losses, stop and resume."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from torch import nn  # noqa: E402

from entrack import filter as cf  # noqa: E402
from entrack.config import FilterConfig, WindowConfig  # noqa: E402
from entrack.datasets.sequence import Sequence  # noqa: E402
from entrack.errors import EntrackError  # noqa: E402
from entrack.trunk import load_trunk  # noqa: E402
from entrack.trunks import checkpoint, crops, pairs  # noqa: E402
from entrack.trunks.distil import DistilConfig, distance, schedule  # noqa: E402
from entrack.trunks.finetune import Filter, FinetuneConfig, found, response_loss  # noqa: E402
from entrack.trunks.material import Material  # noqa: E402
from entrack.trunks.networks import (  # noqa: E402
    ResNet18,
    Student,
    StudentConfig,
    as_input,
    fold_all,
    fold_input,
)
from entrack.trunks.pairs import Pair, PairConfig, from_sequence, from_still, labels  # noqa: E402
from entrack.trunks.train import TrunkTrainConfig, pairs_from, train_trunk  # noqa: E402
from trunk_files import SMALL, picture, student  # noqa: E402

# Networks


@pytest.mark.parametrize("block", ["basic", "rep", "separable"])
def test_folding_changes_nothing(block: str):
    config = StudentConfig(stem=(8, 16), widths=(16, 16, 24), depths=(2, 1, 2), block=block)
    x = as_input(picture(1, 64, 96)[None])
    with torch.no_grad():
        expected = student(config)(x)
        network = fold_all(student(config))
        torch.testing.assert_close(network(x), expected, rtol=1e-4, atol=1e-5)
    assert not any(isinstance(m, nn.BatchNorm2d) for m in network.modules())


def test_folding_the_input_changes_the_border_only():
    """Padding is grey instead of ImageNet's mean colour; cells that do not see it stay the same."""
    config = StudentConfig(stem=(8, 16), widths=(16, 16, 24), depths=(1, 1, 1))
    x = as_input(picture(1, 288, 288)[None])
    with torch.no_grad():
        expected = fold_all(student(config))(x)
        seen = fold_input(fold_all(student(config)))(x)
    torch.testing.assert_close(seen[..., 6:12, 6:12], expected[..., 6:12, 6:12])
    assert (seen - expected)[..., 0, :].abs().max() > 1e-3
    cosine = nn.functional.cosine_similarity(seen, expected)
    assert cosine.mean() > 0.999


def test_every_network_has_the_papers_output_shape():
    x = torch.zeros(2, 3, 96, 64)
    for network in (Student(SMALL), ResNet18()):
        assert network.eval()(x).shape == (2, 256, 6, 4)


# The filter in torch


def test_torch_filter_is_the_trackers_filter():
    n, config = 18, FilterConfig(label_sigma=0.13, regularisation=0.05)
    rng = np.random.default_rng(0)
    x, z = rng.random((2, 3, 16, n, n), np.float32)
    ours = Filter(n, config, WindowConfig())
    weights = ours.fit(torch.from_numpy(x))
    responses = ours.respond(weights, torch.from_numpy(z)).numpy()
    taper = cf.hann(n)
    label = cf.spectrum(cf.label(n, 0.13 * n / WindowConfig().context))
    for k in range(3):
        expected = cf.fit(cf.spectrum(x[k] * taper), label, 0.05)
        np.testing.assert_allclose(weights[k].numpy(), expected, rtol=1e-3, atol=1e-6)
        expected = cf.respond(expected, cf.spectrum(z[k] * taper))
        np.testing.assert_allclose(responses[k], expected, rtol=1e-3, atol=1e-5)


def test_gradients_flow_through_the_filter():
    x = torch.rand(2, 4, 18, 18, dtype=torch.float64, requires_grad=True)
    ours = Filter(18, FilterConfig(), WindowConfig()).double()
    assert torch.autograd.gradcheck(
        lambda t: ours.respond(ours.fit(t[:1]), t[1:]).sum((1, 2)), x, fast_mode=True
    )


def test_response_loss_prefers_the_right_place_and_silent_strangers():
    config = FinetuneConfig(negatives=1)
    ours = Filter(18, FilterConfig(), WindowConfig())
    rng = np.random.default_rng(0)
    templates = torch.from_numpy(rng.random((4, 32, 18, 18), np.float32))
    centred, beside = [pair(0.0, 0.0)] * 4, [pair(0.25, 0.0)] * 4
    here, there = (
        torch.from_numpy(labels(p, 18, ours.sigma, config.scale_spread)) for p in (centred, beside)
    )
    right, near = response_loss(ours, templates, templates, here, config)
    wrong, off = response_loss(ours, templates, templates, there, config)
    assert right < 0.2 * wrong and (near, off) == (1, 0)
    twins = templates[:1].expand(4, -1, -1, -1)  # every stranger looks like the target
    alike, _ = response_loss(ours, twins, twins, here, config)
    assert alike > 2 * right


def test_found_counts_neighbouring_cells():
    responses, wanted = torch.zeros(3, 18, 18), torch.zeros(3, 18, 18)
    wanted[:, 9, 9] = 1
    responses[0, 9, 9] = responses[1, 10, 8] = responses[2, 9, 11] = 1
    assert found(responses, wanted) == pytest.approx(2 / 3)


# Losses


def test_distance_is_relative_and_zero_for_the_teacher_itself():
    features = torch.rand(2, 256, 3, 3)
    assert distance(features, features) == pytest.approx(0, abs=1e-6)
    assert distance(2 * features, features) == pytest.approx(1, abs=1e-3)  # only the size is wrong
    assert distance(20 * features, 10 * features) == pytest.approx(1, abs=1e-3)
    assert distance(-features, features) == pytest.approx(4 + 2, abs=1e-3)


def test_schedule_warms_up_and_decays():
    rates = [schedule(step, 1000) for step in range(1000)]
    assert max(rates) == rates[29] == 1 and rates[0] == pytest.approx(1 / 30)
    assert (np.diff(rates[30:]) < 0).all() and rates[-1] == pytest.approx(0.01, abs=1e-4)


# Pairs


def compass(height: int = 300, width: int = 400) -> np.ndarray:
    """A picture whose blue tells x and whose green tells y."""
    y, x = np.mgrid[:height, :width]
    blue, green = 255 * (x + 0.5) / width, 255 * (y + 0.5) / height
    return np.stack([blue, green, 0 * blue], axis=-1).round().astype(np.uint8)


def at(patch: np.ndarray, dx: float, dy: float) -> np.ndarray:
    """Blue and green of a patch at an offset from its centre, in shares of its side."""
    x, y = (round((0.5 + d) * 288 - 0.5) for d in (dx, dy))
    return patch[y, x, :2].astype(float)


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave colours alone."""
    monkeypatch.setattr(pairs, "photometric", lambda image, rng: image)
    monkeypatch.setattr(pairs, "grey", lambda image: image)


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize("replace", [0.0, 1.0])
def test_offset_of_a_still_is_where_the_template_is_found(replace: float):
    config = PairConfig(replace=replace, occlude=0, zoom=0.3)
    image, other = compass(), np.full((200, 200, 3), 255, np.uint8)
    offsets = []
    for seed in range(40):
        pair = from_still(image, [other], config, np.random.default_rng(seed))
        np.testing.assert_allclose(at(pair.search, *pair.offset), at(pair.template, 0, 0), atol=3)
        offsets.append(pair.offset)
    assert np.abs(offsets).max(axis=0).min() > 0.15  # both far enough to tell


@pytest.mark.usefixtures("plain")
def test_offset_of_a_clip_is_where_the_target_is_found():
    """The target is the same place of the picture in every frame; the second frame is shifted."""
    image = compass()
    moved = np.roll(image, (10, 20), (0, 1))
    boxes = np.array([[150, 100, 60, 50], [170, 110, 60, 50]], float)
    sequence = Sequence("two", [image, moved], boxes, np.zeros(2, bool))
    for seed in range(40):
        pair = from_sequence(sequence, PairConfig(), np.random.default_rng(seed))
        np.testing.assert_allclose(at(pair.search, *pair.offset), at(pair.template, 0, 0), atol=3)


def test_zoom_is_the_windows_size_against_the_right_one():
    """A square target of known size looks 1 / zoom as large in the search patch."""
    frame = np.zeros((400, 400, 3), np.uint8)
    frame[180:220, 180:220] = 255
    box = np.array([[180, 180, 40, 40]] * 2, float)
    sequence = Sequence("still", [frame, frame], box, np.zeros(2, bool))
    for seed in range(10):
        config = PairConfig(shift=0.0, zoom=0.3)
        pair = from_sequence(sequence, config, np.random.default_rng(seed))
        side = np.sqrt((pair.search > 127).all(axis=2).sum())
        if 0 < side < 200:  # brightness may have changed beyond telling
            assert side == pytest.approx(96 / pair.zoom, rel=0.05)


def test_clips_without_usable_boxes_give_no_pair():
    frame = picture(0)
    for box in ([np.nan] * 4, [10, 10, 2, 30], [-90, 10, 100, 100]):
        sequence = Sequence("bad", [frame], np.array([box], float), np.zeros(1, bool))
        assert from_sequence(sequence, PairConfig(), np.random.default_rng(0)) is None
    box = np.array([[40, 40, 50, 50]], float)
    absent = Sequence("absent", [frame], box, np.ones(1, bool))
    assert from_sequence(absent, PairConfig(), np.random.default_rng(0)) is None
    draw = pairs_from(Material([frame], [absent]), FinetuneConfig(stills=0, made=0))
    with pytest.raises(EntrackError, match="hardly any usable boxes"):
        draw(np.random.default_rng(0), 2)


def pair(dx: float, dy: float, zoom: float = 1.0) -> Pair:
    """A pair without pictures."""
    box = np.array([0.5 + dx - 1 / 6, 0.5 + dy - 1 / 6, 1 / 3, 1 / 3])
    held = np.array([1 / 3, 1 / 3, np.log(zoom), np.log(zoom)])
    return Pair(np.empty(0), np.empty(0), (dx, dy), zoom, box, held, np.full(4, 1 / 3))


def test_labels_stand_at_the_offset_and_fall_with_a_wrong_scale():
    maps = labels([pair(0, 0), pair(2 / 18, -3 / 18), pair(0, 0, 1.3)], 18, 0.6, 0.25)
    np.testing.assert_allclose(maps[0], cf.label(18, 0.6), atol=1e-6)
    assert np.unravel_index(maps[1].argmax(), (18, 18)) == (6, 11)
    expected = np.exp(-0.5 * (np.log(1.3) / 0.25) ** 2)
    np.testing.assert_allclose(maps[2], expected * maps[0], atol=1e-6)


def test_the_filter_finds_the_offset_in_pixels():
    """Template and search patch of a still, with colours as features: the peak is at the offset."""
    image = picture(5, 400, 400)
    config = PairConfig(replace=0, occlude=0, rotation=0, zoom=0.02, shift=0.2)
    ours = Filter(18, FilterConfig(), WindowConfig())
    right = 0
    for seed in range(20):
        pair = from_still(image, [image], config, np.random.default_rng(seed))
        x, z = (
            torch.from_numpy(p.reshape(18, 16, 18, 16, 3).mean((1, 3)).astype(np.float32) - 128)
            for p in (pair.template, pair.search)
        )
        x, z = (t.permute(2, 0, 1)[None] for t in (x, z))
        response = ours.respond(ours.fit(x), z)
        wanted = torch.from_numpy(labels([pair], 18, ours.sigma, 0.25))
        right += float(found(response, wanted))
    assert right >= 15


# Crops


def test_crops_are_deterministic_and_of_their_size():
    pictures = [picture(seed) for seed in range(3)]
    one, again, other = (
        crops.batch(pictures, 4, 64, np.random.default_rng(seed)) for seed in (0, 0, 1)
    )
    assert one.shape == (4, 64, 64, 3) and one.dtype == np.uint8
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


# Checkpoints


def test_a_run_folder_belongs_to_one_configuration(tmp_path: Path):
    run = tmp_path / "run"
    checkpoint.claim(run, {"seed": 0, "widths": (1, 2)}, resume=False)
    with pytest.raises(EntrackError, match="holds a run already: add --resume"):
        checkpoint.claim(run, {"seed": 0, "widths": (1, 2)}, resume=False)
    checkpoint.claim(run, {"seed": 0, "widths": (1, 2)}, resume=True)
    with pytest.raises(EntrackError, match="another configuration: seed is 0 there, 1 here"):
        checkpoint.claim(run, {"seed": 1, "widths": (1, 2)}, resume=True)
    assert json.loads((run / "config.json").read_text())["seed"] == 0


def train_a_little(network: nn.Module, optimiser: torch.optim.Optimizer, steps: range) -> None:
    network.train()
    for step in steps:
        x = torch.randn(4, 3, 32, 32, generator=torch.Generator().manual_seed(step))
        optimiser.zero_grad()
        network(x).square().mean().backward()
        optimiser.step()


def test_checkpoints_restore_weights_statistics_and_optimiser_to_the_bit(tmp_path: Path):
    def fresh(seed: int) -> tuple[nn.Module, torch.optim.Optimizer]:
        network = student(seed=seed).to(memory_format=torch.channels_last)
        return network, torch.optim.AdamW(network.parameters(), 1e-2)

    network, optimiser = fresh(0)
    train_a_little(network, optimiser, range(3))
    checkpoint.save(tmp_path / "state.safetensors", network, optimiser, 3)
    train_a_little(network, optimiser, range(3, 6))
    again, its = fresh(1)
    assert checkpoint.load(tmp_path / "state.safetensors", again, its) == 3
    train_a_little(again, its, range(3, 6))
    for key, value in network.state_dict().items():
        torch.testing.assert_close(again.state_dict()[key], value, rtol=0, atol=0, msg=key)


def test_logs_forget_what_will_be_written_again(tmp_path: Path):
    log = checkpoint.Log(tmp_path, "distil", 0)
    for step in (20, 40, 60):
        log.write(step, {"loss": 1 / step})
    checkpoint.Log(tmp_path, "distil", 40).write(60, {"loss": 0.5})
    rows = list(csv.DictReader((tmp_path / "distil.csv").open()))
    assert [(row["step"], row["loss"]) for row in rows] == [
        ("20", "0.05"),
        ("40", "0.025"),
        ("60", "0.5"),
    ]


# The whole


TINY = TrunkTrainConfig(
    seed=3,
    threads=1,
    student=SMALL,
    distil=DistilConfig(crops=480, size=32, batch=2, lr=3e-3),
    finetune=(FinetuneConfig(pairs=4, batch=2, anchor_crops=2, negatives=1),),
)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A teacher of random weights."""
    path = tmp_path_factory.mktemp("teacher") / "folded.npz"
    torch.manual_seed(0)
    np.savez(path, **{k: v.numpy() for k, v in ResNet18().state_dict().items()})
    return path


@pytest.fixture(scope="module")
def material() -> Material:
    frames = [picture(seed) for seed in range(10, 14)]
    boxes = np.array([[60 + 5 * t, 50, 60, 50] for t in range(4)], float)
    clip = Sequence("clip", frames, boxes, np.zeros(4, bool))
    return Material([picture(seed) for seed in range(4)], [clip], [], [picture(20)])


@pytest.fixture(scope="module")
def finished(
    weights: Path, material: Material, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[tuple[str, int, int]]]:
    """A run from start to end, and what it reported."""
    run = tmp_path_factory.mktemp("runs") / "whole"
    said: list[tuple[str, int, int]] = []
    train_trunk(TINY, material, weights, run, report=lambda *told: said.append(told[:3]))
    return run, said


def test_training_makes_a_trunk_and_leaves_no_teacher(finished):
    run, said = finished
    features = load_trunk(run / "trunk.onnx", threads=1)(np.zeros((1, 64, 64, 3), np.uint8))
    assert features.shape == (1, 256, 4, 4) and np.isfinite(features).all()
    assert not (run / "teacher.onnx").exists()
    assert said == [("distil", step, 240) for step in range(20, 241, 20)] + [("finetune 1", 2, 2)]


def test_the_student_learns_what_the_teacher_says(finished):
    run, _ = finished
    losses = [float(row["loss"]) for row in csv.DictReader((run / "distil.csv").open())]
    assert losses[-1] < 0.9 * losses[0]


class Stop(BaseException):
    """Ctrl-C at a chosen moment."""


@pytest.mark.parametrize("moment", [("distil", 220), ("distil", 240), ("finetune 1", 2)])
def test_a_stopped_run_resumes_to_the_same_bits(
    moment: tuple[str, int], finished, weights: Path, material: Material, tmp_path: Path
):
    def stop(stage: str, step: int, steps: int, values: dict[str, float]) -> None:
        if (stage, step) == moment:
            raise Stop

    with pytest.raises(Stop):
        train_trunk(TINY, material, weights, tmp_path / "run", report=stop)
    train_trunk(TINY, material, weights, tmp_path / "run", resume=True)
    whole = finished[0] / "trunk.onnx"
    assert (tmp_path / "run" / "trunk.onnx").read_bytes() == whole.read_bytes()


def test_another_configuration_is_refused(finished, weights: Path, material: Material):
    other = TrunkTrainConfig(seed=4, student=SMALL)
    with pytest.raises(EntrackError, match="another configuration"):
        train_trunk(other, material, weights, finished[0], resume=True)


def test_another_seed_is_another_trunk(finished, weights: Path, material: Material, tmp_path: Path):
    other = train_trunk(replace(TINY, seed=4), material, weights, tmp_path / "run")
    assert other.read_bytes() != (finished[0] / "trunk.onnx").read_bytes()
