"""RAM and RAM++ from the authors' checkpoints: tags of a picture.

Zhang et al., "Recognize Anything: A Strong Image Tagging Model", CVPRW 2024; Huang et al., "Open-Set Image Tagging with
Multi-Grained Text Supervision" (RAM++), 2023. Needs the authors' package ``ram``
(github.com/xinyu1205/recognize-anything). One graph from the picture to a logit a tag: the texts of the tags are in it.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.export.common import (
    as_module,
    export_graph,
    fill,
    load_weights,
    noise,
    require,
    sized,
    write_contract,
)

MEAN, STD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
"""Of ImageNet, RGB from 0 to 1."""
SIDE = 384
"""px of the picture."""
COMPUTED = ("relative_position_index", "attn_mask")
"""Numbers of the Swin encoder that follow from its size, not from training."""
READ = (
    *("visual_encoder.", "image_proj.", "wordvec_proj.", "tagging_head.", "fc.", "label_embed"),
    "reweight_scale",
)
"""Beginnings of the names of the weights that tags come from; the model also writes captions."""


def export_ram(source: Path, folder: Path, name: str = "", text_encoder: str = "bert-base-uncased") -> Path:
    """Graph, names and thresholds of the tags, and contract of RAM or RAM++; returns the contract's path.

    Parameters
    ----------
    source
        ``ram_swin_large_14m.pth`` or ``ram_plus_swin_large_14m.pth``.
    name
        Of the model; ram or ram-plus without it.
    text_encoder
        Where transformers finds the tokenizer of BERT, which the authors' class loads though tags need none of it: a
        folder, or the name under which it was fetched before.

    Raises
    ------
    ModelError
        The package is missing, the file is of another network, or the graph gives other values than torch.
    """
    require("ram", "timm", "transformers")
    from ram.models import ram, ram_plus

    weights = load_weights(source)
    plus = "reweight_scale" in weights
    try:
        build = ram_plus if plus else ram
        model = build(pretrained="", image_size=SIDE, vit="swin_l", text_encoder_type=text_encoder)
    except OSError as error:
        raise ModelError(
            f"the tokenizer {text_encoder} is not here; give the folder that holds bert-base-uncased ({error})"
        ) from error
    # older files name the head after what it was before; what follows from the size is the model's own
    named = {key.replace("vision_multi", "tagging_head"): value for key, value in weights.items()}
    own = model.state_dict()
    wanted = {key for key in own if key.startswith(READ) and not key.endswith(COMPUTED)}
    rest = {key: value for key, value in own.items() if key not in wanted}
    given = {key: value for key, value in named.items() if key in wanted}
    return export_tagger(fill(model, rest | given, source), folder, name or ("ram-plus" if plus else "ram"))


def export_tagger(model: Any, folder: Path, name: str) -> Path:
    """Graph, names and thresholds, and contract of a ``RAM`` or ``RAM_plus`` of the package ``ram``."""
    import ram

    side = int(model.visual_encoder.patch_embed.img_size[0])
    network = as_module(lambda image: tag_logits(model, image), model)
    path = folder / f"{name}.onnx"
    export_graph(network, [noise(1, (side, side)) * 4 - 2], path, ["image"], ["logits"])
    data = Path(ram.__file__).parent / "data"
    names, thresholds = "ram_tag_list.txt", "ram_tag_list_threshold.txt"
    for file in (names, thresholds):
        shutil.copyfile(data / file, folder / file)
    content = {
        "name": name,
        "task": "tags",
        "licence": "Apache-2.0",
        "commercial": True,
        "source": "https://github.com/xinyu1205/recognize-anything",
        "graph": {"main": {"file": path.name, "outputs": {"scores": "logits"}}},
        "input": {
            "colour_order": "RGB",
            "scale": 1 / 255,
            "mean": MEAN,
            "std": STD,
            "resize": {"rule": "stretch", "height": side, "width": side, "interpolation": "antialias"},
        },
        "tags": {
            "names": sized(folder, names),
            "thresholds": sized(folder, thresholds),
            "meaning": "logits",
        },
    }
    return write_contract(folder, content)


def tag_logits(model: Any, image: Any) -> Any:
    """(1, K) logits of the tags of a picture (1, 3, s, s).

    RAM++ first weighs the descriptions of every tag by how well each fits the picture.
    """
    import torch

    tokens = model.image_proj(model.visual_encoder(image))
    labels = model.label_embed
    if hasattr(model, "reweight_scale"):
        whole = torch.nn.functional.normalize(tokens[:, 0], dim=-1)
        each = labels.view(model.num_class, -1, labels.shape[-1])
        fit = (model.reweight_scale.exp() * whole @ labels.t()).view(model.num_class, -1)
        labels = (fit.softmax(1)[..., None] * each).sum(1)
    queries = torch.relu(model.wordvec_proj(labels))[None]
    seen = model.tagging_head(
        encoder_embeds=queries,
        encoder_hidden_states=tokens,
        encoder_attention_mask=torch.ones(tokens.shape[:-1], dtype=torch.long),
        return_dict=False,
        mode="tagging",
    )
    return model.fc(seen[0]).squeeze(-1)
