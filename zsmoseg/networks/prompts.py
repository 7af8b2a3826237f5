"""Phrases as the tokens of a text-prompted detector: WordPiece, a mask of phrases, spans to read the scores at.

The rules are those of Grounding DINO (Liu et al., ECCV 2024, section 3.4 "Sub-sentence level text feature"; code of
IDEA-Research): lower case, a "." behind each phrase, and a token attends to the tokens of its own phrase only, so
that a phrase's scores do not depend on its neighbours.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import ModelError, SettingsError

if TYPE_CHECKING:
    from tokenizers import Tokenizer

MOST_TOKENS = 256
"""Tokens that the text side of Grounding DINO was trained with, [CLS] and [SEP] included."""
SEPARATORS = re.compile(r"[,;\n]|\.(?=\s|$)")
"""Between the phrases of what a user types: a comma, a semicolon, or a full stop, at which the detector cuts too."""


@dataclass(frozen=True)
class Prompt:
    """The tokens of some phrases.

    Attributes
    ----------
    phrases : which of the phrases asked for are in it.
    spans : for each of them its tokens [first, last + 1), without the full stop behind it.
    input_ids, token_type_ids, attention_mask, position_ids : (1, T) int64; positions start anew in each phrase.
    text_token_mask : (1, T, T) whether a token attends to another.
    """

    phrases: tuple[int, ...]
    spans: tuple[tuple[int, int], ...]
    input_ids: NDArray[np.int64]
    token_type_ids: NDArray[np.int64]
    attention_mask: NDArray[np.int64]
    position_ids: NDArray[np.int64]
    text_token_mask: NDArray[np.bool_]


def parse_prompt(text: str) -> tuple[str, ...]:
    """Phrases that a user typed: "person, dog" or "person . dog ."; said twice counts once, the order is kept.

    Raises
    ------
    SettingsError
        There is no phrase in it.
    """
    phrases = tuple(dict.fromkeys(filter(None, (clean_phrase(part) for part in SEPARATORS.split(text)))))
    if not phrases:
        raise SettingsError(f'the prompt "{text}" has no phrase: write for example "person, dog"')
    return phrases


def clean_phrase(phrase: str) -> str:
    """A phrase in lower case, without full stops and question marks, at which the detector would cut it in two."""
    return " ".join(re.sub(r"[.?]", " ", phrase).lower().split())


def tokenizer_of(content: bytes, name: str) -> Tokenizer:
    """The WordPiece tokenizer of uncased BERT.

    Parameters
    ----------
    content : of ``vocab.txt``, one token a line, or of a ``tokenizer.json`` of the library tokenizers.
    name : of the file.

    Raises
    ------
    ModelError
        It is no vocabulary, or lacks one of the tokens [CLS], [SEP], [UNK] and ".".
    """
    from tokenizers import Tokenizer, models, normalizers, pre_tokenizers

    try:
        if name.endswith(".json"):
            tokenizer = Tokenizer.from_str(content.decode("utf-8"))
            tokenizer.no_truncation()
            tokenizer.no_padding()
        else:
            lines = content.decode("utf-8").rstrip("\n").split("\n")
            words = {line.rstrip("\r"): number for number, line in enumerate(lines)}
            tokenizer = Tokenizer(models.WordPiece(words, unk_token="[UNK]", max_input_chars_per_word=100))
            tokenizer.normalizer = normalizers.BertNormalizer(lowercase=True)
            tokenizer.pre_tokenizer = pre_tokenizers.BertPreTokenizer()
    except Exception as error:  # the library raises bare exceptions only
        raise ModelError(f"{name} is no vocabulary ({error}); fetch the model again") from error
    for token in ("[CLS]", "[SEP]", "[UNK]", "."):
        if tokenizer.token_to_id(token) is None:
            raise ModelError(f'{name} has no token "{token}"; it is not the vocabulary of uncased BERT')
    return tokenizer


def prompts_of(
    phrases: Sequence[str], tokenizer: Tokenizer, most: int = MOST_TOKENS, alone: bool = False
) -> list[Prompt]:
    """Phrases as prompts of at most so many tokens, cut at borders of phrases.

    Parameters
    ----------
    phrases : what to look for; upper case, full stops and question marks in them are taken out.
    tokenizer : see :func:`tokenizer_of`.
    most : tokens of a prompt, the two at its ends included.
    alone : a prompt for each phrase, for graphs whose mask of phrases is fixed to one phrase.

    Raises
    ------
    SettingsError
        There is no phrase, or one is empty, unknown to the vocabulary or too long; it is named.
    """
    if not phrases:
        raise SettingsError("there is no phrase to look for: name some, or lower the thresholds of the tags")
    pieces = [_tokens(phrase, tokenizer, most) for phrase in phrases]
    prompts, chosen, length = [], list[int](), 2
    for index, piece in enumerate(pieces):
        if chosen and (alone or length + len(piece) + 1 > most):
            prompts.append(_prompt(chosen, pieces, tokenizer))
            chosen, length = [], 2
        chosen.append(index)
        length += len(piece) + 1
    return [*prompts, _prompt(chosen, pieces, tokenizer)]


def _tokens(phrase: str, tokenizer: Tokenizer, most: int) -> list[int]:
    """Token ids of one phrase, without ends and full stop."""
    clean = clean_phrase(phrase)
    if not clean:
        raise SettingsError(f'the phrase "{phrase}" is empty: name what to look for')
    ids = list(tokenizer.encode(clean, add_special_tokens=False).ids)
    if not ids or set(ids) == {tokenizer.token_to_id("[UNK]")}:
        raise SettingsError(f'the phrase "{phrase}" has no word that the detector knows: use English words')
    if len(ids) + 3 > most:
        raise SettingsError(
            f'the phrase "{phrase[:40]}..." has {len(ids)} tokens of at most {most - 3}: shorten it'
        )
    return ids


def _prompt(chosen: Sequence[int], pieces: Sequence[list[int]], tokenizer: Tokenizer) -> Prompt:
    """[CLS] phrase . phrase . [SEP], each phrase with its full stop a block of the mask."""
    stop = tokenizer.token_to_id(".")
    ids, positions, blocks, spans = [tokenizer.token_to_id("[CLS]")], [0], [0], []
    for number, index in enumerate(chosen, 1):
        piece = [*pieces[index], stop]
        spans.append((len(ids), len(ids) + len(piece) - 1))
        ids += piece
        positions += range(len(piece))
        blocks += [number] * len(piece)
    ids.append(tokenizer.token_to_id("[SEP]"))
    positions.append(0)
    blocks.append(len(chosen) + 1)
    row = np.array([ids], np.int64)
    block = np.array(blocks)
    return Prompt(
        tuple(chosen),
        tuple(spans),
        input_ids=row,
        token_type_ids=np.zeros_like(row),
        attention_mask=np.ones_like(row),
        position_ids=np.array([positions], np.int64),
        text_token_mask=(block[:, None] == block)[None],
    )


def padded(prompt: Prompt, length: int) -> Prompt:
    """A prompt with tokens behind its end that attend to themselves only, for graphs of a fixed text length.

    Parameters
    ----------
    length : tokens afterwards, at least those that are there.
    """
    more = length - prompt.input_ids.shape[1]
    ends = ((0, 0), (0, more))
    mask = np.pad(prompt.text_token_mask, ((0, 0), (0, more), (0, more)))
    mask |= np.eye(length, dtype=bool)
    return Prompt(
        prompt.phrases,
        prompt.spans,
        input_ids=np.pad(prompt.input_ids, ends),  # [PAD] is token 0 of BERT
        token_type_ids=np.pad(prompt.token_type_ids, ends),
        attention_mask=np.pad(prompt.attention_mask, ends),
        position_ids=np.pad(prompt.position_ids, ends),
        text_token_mask=mask,
    )
