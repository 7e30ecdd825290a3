"""What runs a pass: this process on data in memory, or on data that it reads anew for every pass; or a cluster.

An engine is given parts of the data and keeps a *shard* of each, wherever it likes. A pass is a function of one shard;
its results come back in the order of the parts, so that sums do not depend on which was first.
"""

from __future__ import annotations

from rpil.engines.dask import DaskEngine
from rpil.engines.memory import InMemory
from rpil.engines.protocol import Engine, Shards
from rpil.engines.streamed import Streamed

__all__ = ["DaskEngine", "Engine", "InMemory", "Shards", "Streamed"]
