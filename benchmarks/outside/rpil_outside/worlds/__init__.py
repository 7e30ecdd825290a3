"""Name the worlds."""

from rpil_outside.world import World
from rpil_outside.worlds.babyai import BabyAI
from rpil_outside.worlds.early_release import EarlyRelease
from rpil_outside.worlds.intersection import Intersection
from rpil_outside.worlds.metaworld import MetaWorld
from rpil_outside.worlds.ocbench import OCBench
from rpil_outside.worlds.overcooked import Overcooked
from rpil_outside.worlds.push2d import Push2D

ALL = (Intersection(), EarlyRelease(), Push2D(), MetaWorld(), BabyAI(), Overcooked(), OCBench())
"""In the order of a night: quick ones first."""
WORLDS: dict[str, World] = {world.name: world for world in ALL}
