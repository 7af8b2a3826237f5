"""RAM and RAM++: our picture, graph, probabilities and tags against the authors' transform and ``generate_tag``.

    PYTHONPATH=CLONE:TRANSFORMERS_4.36 python tests/parity/parity_ram.py

with a clone of xinyu1205/recognize-anything, whose text code wants transformers 4 (and fairscale, for a function that
is not called). All of the 4585 tags, tiny encoders, random weights; RAM++ with 3 descriptions a tag in place of 51.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rows import frame, row, shaken

from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.export.ram import export_ram, export_tagger
from zsmoseg.networks.session import Network
from zsmoseg.networks.tags import chosen_tags, tag_names, tag_scores, tag_thresholds

SIDE, WIDTH = 384, 512
SWIN = {"image_res": SIDE, "vision_width": 192, "embed_dim": 24, "depths": [1, 1, 2, 1], "num_heads": [1, 2, 4, 8],
        "window_size": 12}  # fmt: skip


def tiny(plus: bool) -> Any:
    """The authors' class with small parts; the tokenizer of captions, which tags do not need, left out."""
    import torch
    from ram.models import ram as plain
    from ram.models import ram_plus

    torch.manual_seed(0)
    build = ram_plus if plus else plain
    module = __import__(build.__module__, fromlist=["_"])
    ends = SimpleNamespace(input_ids=[0, 0])
    words = type("Words", (), {"__len__": lambda _: 100, "__call__": lambda _, text: ends})()
    module.init_tokenizer = lambda *_: words
    module.read_json = lambda path: SWIN
    module.tie_encoder_decoder_weights = lambda *_: None
    config = module.BertConfig

    def small(path: str) -> Any:
        given = json.loads(Path(path).read_text())
        given |= {
            "hidden_size": 64,
            "intermediate_size": 128,
            "num_attention_heads": 4,
            "num_hidden_layers": 2,
        }
        return config.from_dict({**given, "vocab_size": 100})

    module.BertConfig = SimpleNamespace(from_json_file=small)
    model = build(pretrained="", image_size=SIDE, vit="swin_l")
    descriptions = 3 if plus else 1
    model.label_embed = torch.nn.Parameter(torch.randn(model.num_class * descriptions, WIDTH))
    model = shaken(model)
    with torch.no_grad():  # so that some tags are on
        model.fc.weight *= 6
    return model


def exported(model: Any, folder: Path, plus: bool) -> Path:
    """RAM by way of a checkpoint; RAM++'s own class would want all 51 descriptions."""
    import torch

    folder.mkdir()
    if plus:
        return export_tagger(model, folder, "ram-plus")
    torch.save({"model": model.state_dict()}, folder / "ram.pth")
    return export_ram(folder / "ram.pth", folder)


def compare(name: str, model: Any, contract: Path) -> None:
    import torch
    from ram.transform import get_transform

    network = Network(load_contract(contract.parent), "cpu")
    bgr, picture = frame()
    seen: list[Any] = []
    hook = model.fc.register_forward_hook(lambda *parts: seen.append(parts[-1]))
    with torch.no_grad():
        spoken = model.generate_tag(get_transform(SIDE)(picture)[None])[0][0]
    hook.remove()
    theirs = seen[0][0, :, 0].sigmoid().numpy()
    ours = tag_scores(network, bgr)
    on = chosen_tags(ours, tag_thresholds(network.contract))
    names = tag_names(network.contract)
    same = " | ".join(names[index] for index in on) == spoken
    row(name, "the authors' code, transform and generate_tag", f"{len(ours)} tags",
        f"probabilities {np.abs(ours - theirs).max():.1e} (of {theirs.min():.3f} to {theirs.max():.3f}); "
        f"{len(on)} tags on, {'the same words' if same else 'OTHER WORDS'}")  # fmt: skip


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for plus in (False, True):
            word, model = "RAM++" if plus else "RAM", tiny(plus)
            compare(word, model, exported(model, folder / word, plus))


if __name__ == "__main__":
    main()
