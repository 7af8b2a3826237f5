"""The protocol ``moving`` on one sequence: tracks, multi-label and merged (Dave, Tokmakov, Ramanan 2019), and J."""

from __future__ import annotations

import numpy as np

from zsmoseg.errors import FormatError
from zsmoseg.metrics.clips import Clip, SequenceScore
from zsmoseg.metrics.counts import PairSums, frame_counts
from zsmoseg.metrics.motion_state import motion_scores
from zsmoseg.metrics.regions import merged_j
from zsmoseg.metrics.tracks import match_tracks, merged_scores, multi_label_scores


def score_moving(clip: Clip) -> SequenceScore:
    """Pu, Ru, Fu, multi-label and merged, J merged; with motion times J while moving, and false objects.

    Raises
    ------
    FormatError
        With ``official``, where the published program stops: no background pixel in truth or prediction.
    """
    sums, j, kept, where = PairSums(), [], [], ""
    for frame in clip.frames:
        counts = frame_counts(frame, clip.void)
        sums.add(counts)
        j.append(merged_j(counts))
        where = frame.where
        if clip.times is not None:
            kept.append((frame.number, counts))
    table = sums.table()
    if clip.official and not (0 in table.truth and 0 in table.prediction):
        side = "prediction" if 0 in table.truth else "truth"
        raise FormatError(
            f"{where}: the official program stops at this sequence (KeyError: no background pixel in the {side}); "
            "without --official the value of the formula is given"
        )
    several, merged = multi_label_scores(table), merged_scores(table)
    values = {"Fu": several.fu, "Pu": several.pu, "Ru": several.ru, "Fu_binary": merged.fu}
    values |= {"Pu_binary": merged.pu, "Ru_binary": merged.ru, "J": 100 * float(np.mean(j))}
    match = match_tracks(table)
    if clip.times is not None:
        unknown = sorted(set(clip.times) - set(table.truth.tolist()))
        if unknown:
            raise FormatError(
                f"motion times name the object {unknown[0]}, which the truth of {where} does not have"
            )
        moving = motion_scores(kept, match.partners(), clip.times)
        values |= {"J_moving": moving.j, "false_objects": moving.false_objects}
    return SequenceScore(values, len(match.truth))
