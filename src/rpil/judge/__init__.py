"""The default judge: which demonstrations are an expert's.

    held_out      log pi(a|s) of every step under policies fitted to the other demonstrations
    concentrate   which demonstrations teach: the best explained, chosen and fitted in turn
    effective     how many independent steps a demonstration is worth
    groups        one group of scores, or two
    rivals        whether the rest acts alike, otherwise, in the same states
    judgement     all of it in order

docs/model.md has the formulas.
"""

from rpil.judge.judgement import FINDINGS, Judgement, Settings, judge

__all__ = ["FINDINGS", "Judgement", "Settings", "judge"]
