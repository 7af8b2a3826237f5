"""Grounding DINO: our text, picture, graph and boxes against transformers' processor and model, on a real frame.

    python tests/parity/parity_grounding_dino.py VOCAB_TXT

with the vocabulary of uncased BERT (the tokens that end a phrase are numbers in transformers). Tiny, random weights.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from rows import frame, row, shaken

import zsmoseg.networks.text_boxes as ours
from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.export.grounding_dino import export_grounding_dino
from zsmoseg.networks.prompts import prompts_of, tokenizer_of
from zsmoseg.networks.session import Network

SIZES = ((352, 626), (384, 640))
"""px of the picture: in the first the frame fills it, the second has padding below."""
WORDS = ("dog", "teddy bear", "Red Car", "grass", "a person's hat", "swimming-pool", "café", "tree trunk")


def tiny(folder: Path, vocabulary: Path) -> object:
    """A model of transformers as small as its shape allows, saved as users have it."""
    import torch
    from transformers import BertConfig, GroundingDinoConfig, GroundingDinoForObjectDetection, SwinConfig

    swin = SwinConfig(
        image_size=224, embed_dim=12, depths=[1, 1, 2, 1], num_heads=[1, 2, 3, 4], window_size=7,
        out_features=["stage2", "stage3", "stage4"],
    )  # fmt: skip
    bert = BertConfig(hidden_size=32, num_hidden_layers=2, num_attention_heads=2, intermediate_size=64)
    config = GroundingDinoConfig(
        backbone_config=swin, text_config=bert, d_model=32, num_queries=60, encoder_layers=2, decoder_layers=2,
        encoder_ffn_dim=64, decoder_ffn_dim=64, encoder_attention_heads=2, decoder_attention_heads=2,
    )  # fmt: skip
    torch.manual_seed(0)
    model = shaken(GroundingDinoForObjectDetection(config), scale=0.5)
    model.save_pretrained(folder)
    (folder / "vocab.txt").write_bytes(vocabulary.read_bytes())
    return model


def compare(model: object, network: Network, folder: Path, size: tuple[int, int], count: int) -> None:
    """Scores and boxes of ``count`` phrases."""
    import torch
    from transformers import BertTokenizerFast, GroundingDinoImageProcessorPil, GroundingDinoProcessor

    bgr, picture = frame()
    images = GroundingDinoImageProcessorPil(size={"shortest_edge": size[0], "longest_edge": size[1]})
    processor = GroundingDinoProcessor(images, BertTokenizerFast.from_pretrained(folder))
    phrases = [WORDS[i % len(WORDS)] for i in range(count)]
    asked = processor(images=picture, text=" . ".join(phrases).lower() + " .", return_tensors="pt")
    high, wide = (there - here for there, here in zip(size, asked["pixel_mask"].shape[1:], strict=True))
    for name in ("pixel_values", "pixel_mask"):  # as the processor pads to the largest picture of a batch
        asked[name] = torch.nn.functional.pad(asked[name], (0, wide, 0, high))
    with torch.no_grad():
        out = model(**asked)
    (prompt,) = prompts_of(phrases, tokenizer_of((folder / "vocab.txt").read_bytes(), "vocab.txt"))
    assert asked["input_ids"].tolist() == prompt.input_ids.tolist(), "the same tokens"
    probability = out.logits[0].sigmoid().numpy()
    score = np.stack([probability[:, a:b].max(1) for a, b in prompt.spans], 1)
    (found,) = processor.post_process_grounded_object_detection(
        out, asked["input_ids"], threshold=-1.0, text_threshold=0.0, target_sizes=[bgr.shape[:2]]
    )
    box = found["boxes"].numpy()
    everything = ours.Candidates(floor=-1.0, most=10**6, overlap=1.1)
    raw = ours.text_boxes(network, bgr, [prompt], everything)
    height, width = bgr.shape[:2]
    box = np.clip(box, 0, [width, height, width, height])
    kept = ((box[:, 2:] - box[:, :2]) > 0).all(1)
    box, score = box[kept], score[kept]
    assert len(box) == len(raw.box)
    order = np.argsort(-score.max(1), kind="stable")
    # near-equal scores may change places between two sums of floats: nearest box, then
    match = [int(np.abs(raw.box - b).sum(1).argmin()) for b in box[order]]
    boxes = np.abs(raw.box[match] - box[order]).max()
    scores = np.abs(raw.phrase_score[match] - score[order]).max()
    spread = f"scores {score.min():.3f} to {score.max():.3f}"
    row("Grounding DINO", "transformers 5.24, PIL processor and model", f"{size[1]} x {size[0]}, {count} phrases",
        f"boxes {boxes:.1e} px, scores {scores:.1e} ({spread})")  # fmt: skip


def main(vocabulary: Path) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = tiny(folder / "source", vocabulary)
        for size in SIZES:
            export_grounding_dino(folder / "source", folder / "graphs", height=size[0], width=size[1])
            network = Network(load_contract(folder / "graphs"), "cpu")
            for count in (1, 3, 40):
                compare(model, network, folder / "source", size, count)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
