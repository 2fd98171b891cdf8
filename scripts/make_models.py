"""Write the shipped model folders from the presets, after a trunk or a preset has changed.

python scripts/make_models.py
"""

from entrack.config import Config, read
from entrack.model import SHIPPED, assets, save_model

DESCRIPTIONS = {
    "default": "What `entrack track` uses: the filter of cf and a learned policy, eqs. 1-7 and 14.",
    "policy": "The same as default, by its older name.",
    "longterm": "The model default, and a search for a target that is lost.",
    "cf": "The correlation filter with three sizes, eqs. 1-3 and 14.",
    "quick": "The filter of cf with few passes of the trunk on smaller patches, for many objects.",
    "cf-baseline": "The paper's CF.Baseline: the correlation filter, the size stays.",
}


def main() -> None:
    presets = assets().parent / "presets"
    for name in SHIPPED:
        preset = "default" if name == "policy" else name
        config = read(Config, presets / f"{preset}.toml")
        folder = assets() / "models" / name
        policy = assets() / "models" / "policy" / "policy.safetensors" if config.policy else None
        trunk = assets() / "trunk" / "trunk.onnx"
        save_model(folder, name, DESCRIPTIONS[name], config, trunk, policy)
        print(f"wrote {folder / 'model.toml'}")


if __name__ == "__main__":
    main()
