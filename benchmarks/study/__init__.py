"""The paper's Tables 1-6 and Figures 1-7, with its own recipe beside what became of it.

What the paper leaves out is in the author's public notebook: 10 expert and 10 bad demonstrations, raw observations, no
penalty, P(expert) .2 in Mountain Car, .5 in Lunar Lander, .75 in Acrobot, and a "±" over 20 rollouts of one policy from
one draw of the data. Here every figure has an interval over draws of the data, and the paper's own way beside it.
"""

from __future__ import annotations
