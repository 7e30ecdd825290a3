"""Array types with shapes: ``Float[Array, "N D"]`` is a floating array of N rows and D columns.

Type checkers see NumPy arrays. The tests check shapes as well, by jaxtyping and beartype, which they import first;
users do not need them.

    N  steps                 D  observations, or columns of a design matrix
    M  demonstrations        K  discrete actions
    U  demonstrators         A  parts of a continuous action
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from typing import Annotated as Bool
    from typing import Annotated as Float
    from typing import Annotated as Int
    from typing import Annotated as Num
    from typing import Annotated as Shaped

    from numpy.typing import NDArray

    Array = NDArray[Any]
else:
    Array = np.ndarray
    if "jaxtyping" in sys.modules:
        from jaxtyping import Bool, Float, Int, Num, Shaped
    else:

        class Shaped:
            """The array type alone: ``Shaped[Array, "N"]`` is ``Array``."""

            def __class_getitem__(cls, item):
                return item[0]

        Bool = Float = Int = Num = Shaped

__all__ = ["Array", "Bool", "Float", "Int", "Num", "Shaped"]
