import rpil
from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.formats import registry
from rpil.formats.format import Format
from rpil.formats.recording import from_demonstrations
from rpil.formats.registry import find


def test_a_layout_comes_before_the_extension(tmp_path, monkeypatch):
    kept, toy = [], Demonstrations.from_episodes([([[1.0], [2.0]], [0, 1])])
    own = Format(
        "mine",
        claims=lambda path: path.read_text() == "mine",
        read=lambda path, options: from_demonstrations(toy, "mine"),
        keep=lambda *given: kept.append(given[:3]),
        has_own_ids=True,
    )
    monkeypatch.setattr(registry, "FORMATS", [own, *registry.FORMATS])
    mine, other = tmp_path / "mine.csv", tmp_path / "other.csv"
    mine.write_text("mine")
    other.write_text("episode_index,action,observation.x\n0,a,1\n")
    assert formats.read_recording(mine).description.format == "mine"
    find(mine).keep(tmp_path / "out.csv", [1])
    assert kept == [(mine, tmp_path / "out.csv", [1])]
    assert rpil.read(other).ids == (0,)
