"""ResNet-18 in every layout that exists becomes the same trunk and a model that tracks."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from safetensors.torch import save_file  # noqa: E402
from torch import nn  # noqa: E402

import entrack  # noqa: E402
from entrack.errors import EntrackError  # noqa: E402
from entrack.model import load_model  # noqa: E402
from entrack.trunk import load_trunk  # noqa: E402
from entrack.trunks.importing import folded, import_trunk, read_resnet18, read_weights  # noqa: E402
from entrack.trunks.networks import ResNet18, as_input  # noqa: E402


class Block(nn.Module):
    """torchvision's BasicBlock."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.downsample = None
        if stride > 1:
            convolution = nn.Conv2d(inputs, outputs, 1, stride, bias=False)
            self.downsample = nn.Sequential(convolution, nn.BatchNorm2d(outputs))

    def forward(self, x):
        y = self.bn2(self.conv2(torch.relu(self.bn1(self.conv1(x)))))
        return torch.relu(y + (x if self.downsample is None else self.downsample(x)))


class Original(nn.Module):
    """torchvision's and timm's ResNet-18, by the names of their state."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.layer1 = nn.Sequential(Block(64, 64, 1), Block(64, 64, 1))
        self.layer2 = nn.Sequential(Block(64, 128, 2), Block(128, 128, 1))
        self.layer3 = nn.Sequential(Block(128, 256, 2), Block(256, 256, 1))
        self.layer4 = nn.Sequential(Block(256, 512, 2), Block(512, 512, 1))
        self.fc = nn.Linear(512, 1000)

    def forward(self, x):
        """RGB, normalised → layer3."""
        x = torch.max_pool2d(torch.relu(self.bn1(self.conv1(x))), 3, 2, 1)
        return self.layer3(self.layer2(self.layer1(x)))


@pytest.fixture(scope="module")
def original() -> Original:
    """Random weights, and batch norms whose statistics matter."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    network = Original().eval()
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean, -0.5, 0.5)
            nn.init.uniform_(module.running_var, 0.5, 2.0)
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.uniform_(module.bias, -0.5, 0.5)
    return network


@pytest.fixture(scope="module")
def patch() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (1, 64, 64, 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def expected(original: Original, patch: np.ndarray) -> np.ndarray:
    rgb = torch.from_numpy(patch[..., ::-1].copy()).permute(0, 3, 1, 2) / 255
    mean = torch.tensor([0.485, 0.456, 0.406]).reshape(3, 1, 1)
    std = torch.tensor([0.229, 0.224, 0.225]).reshape(3, 1, 1)
    with torch.no_grad():
        return original((rgb - mean) / std).numpy()


def write(original: Original, folder: Path, layout: str) -> Path:
    state = original.state_dict()
    if layout == "pth":
        torch.save(state, folder / "resnet18-f37072fd.pth")
        return folder / "resnet18-f37072fd.pth"
    if layout == "safetensors":
        save_file(state, folder / "model.safetensors")
        return folder / "model.safetensors"
    if layout == "half":
        kept = {k: v.bfloat16() for k, v in state.items() if "num_batches" not in k}
        save_file(kept, folder / "half.safetensors")
        return folder / "half.safetensors"
    np.savez(folder / "folded.npz", **folded(read_weights(write(original, folder, "pth")), "x"))
    return folder / "folded.npz"


@pytest.mark.parametrize(
    ("layout", "tolerance"), [("pth", 1e-4), ("safetensors", 1e-4), ("npz", 1e-4), ("half", 0.1)]
)
def test_every_layout_says_what_the_original_says(
    original: Original,
    patch: np.ndarray,
    expected: np.ndarray,
    tmp_path: Path,
    layout: str,
    tolerance: float,
):
    weights = folded(read_weights(write(original, tmp_path, layout)), "x")
    with torch.no_grad():
        found = ResNet18().load_folded(weights).eval()(as_input(patch)).numpy()
    np.testing.assert_allclose(found, expected, atol=tolerance * expected.max())


def test_import_makes_a_model_that_tracks(original: Original, tmp_path: Path):
    file = write(original, tmp_path, "pth")
    trunk = import_trunk(file, tmp_path / "paper")
    features = load_trunk(trunk)(np.zeros((1, 288, 288, 3), np.uint8))
    assert features.shape == (1, 256, 18, 18)
    config = load_model(tmp_path / "paper").config
    assert (config.window.shape, config.window.border, config.scale.steps) == ("box", "mean", 1)
    tracker = entrack.load(tmp_path / "paper")
    frame = np.random.default_rng(1).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    tracker.init(frame, (60, 40, 40, 40))
    np.testing.assert_allclose(tracker.update(frame).box, [60, 40, 40, 40], atol=0.1)
    with pytest.raises(EntrackError, match="holds a model already"):
        import_trunk(file, tmp_path / "paper")


def test_provenance_is_kept(original: Original, tmp_path: Path):
    file = write(original, tmp_path, "safetensors")
    import_trunk(file, tmp_path / "paper")
    text = (tmp_path / "paper" / "model.toml").read_text()
    assert "model.safetensors" in text
    assert hashlib.sha256(file.read_bytes()).hexdigest() in text


def test_what_is_not_resnet18_is_refused_in_one_sentence(original: Original, tmp_path: Path):
    state = dict(original.state_dict())
    cases = {
        "no conv1.weight": {"stem.weight": torch.zeros(1)},
        "no layer1.0.bn2.running_var: a batch norm is incomplete": {
            k: v for k, v in state.items() if k != "layer1.0.bn2.running_var"
        },
        r"layer2.1.conv1.weight in .* has shape \(128, 64, 3, 3\), ResNet-18 has": state
        | {"layer2.1.conv1.weight": torch.zeros(128, 64, 3, 3)},
    }
    for message, wrong in cases.items():
        torch.save(wrong, tmp_path / "wrong.pth")
        with pytest.raises(EntrackError, match=message):
            import_trunk(tmp_path / "wrong.pth", tmp_path / "out")
    assert not (tmp_path / "out").exists()


class Code:
    """Would run a function when it is unpickled."""

    def __reduce__(self):
        return print, ("unpickled",)


def test_code_in_a_pth_is_never_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    torch.save({"conv1.weight": Code()}, tmp_path / "evil.pth")
    with pytest.raises(EntrackError, match=r"not a \.pth file of named tensors"):
        read_weights(tmp_path / "evil.pth")
    assert "unpickled" not in capsys.readouterr().out


@pytest.mark.parametrize("name", ["broken.pth", "broken.safetensors", "broken.npz"])
def test_broken_files_are_named(tmp_path: Path, name: str):
    (tmp_path / name).write_bytes(b"not weights at all")
    with pytest.raises(EntrackError, match=name):
        read_weights(tmp_path / name)
    with pytest.raises(EntrackError, match="no weights"):
        read_weights(tmp_path / "absent.pth")
    (tmp_path / "weights.bin").write_bytes(b"")
    with pytest.raises(EntrackError, match=r"\.npz, found weights.bin"):
        read_weights(tmp_path / "weights.bin")


def test_reference_trunk_imports_as_it_is(shared: Path, tmp_path: Path, patch: np.ndarray):
    file = shared / "trunk" / "resnet18_layer3_folded.npz"
    with np.load(file) as weights:
        plain = ResNet18().load_folded(dict(weights)).eval()
    with torch.no_grad():
        found = read_resnet18(file)(as_input(patch))
        torch.testing.assert_close(found, plain(as_input(patch)), rtol=0, atol=0)
