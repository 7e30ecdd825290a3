"""Episodes of OCBench's oracles with acts that are mistakes: ``python benchmarks/ocbench_episodes.py FOLDER``.

It needs the package ocbench (MIT, MuJoCo on the CPU) and numpy alone, so that it can run in an environment of its own;
`benchmarks/segments.py` reads the files. An oracle picks an object up and places it, act after act; with the
probability `p_mistake` an act is another one than the task needs, and the acts after it mend it. An episode ends
when the task is done, by a failure, or after the task's number of steps.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

TASKS = {"block": "block-cpu-lite-double-task1-v0", "hanoi": "hanoi-cpu-lite-double-task1-v0"}
P_MISTAKE, SEEDS, EPISODES = (0.1, 0.5), range(5), 50


def episodes(task: str, p_mistake: float, seed: int, n: int) -> dict[str, np.ndarray]:
    """Rows of `n` episodes laid end to end, whether each is of a mistake, and which acts they are."""
    import ocbench
    from ocbench import oracles

    env = ocbench.make(TASKS[task], visualize_info=False)
    controller = getattr(oracles, f"{task.title()}Controller")(env, p_mistake=p_mistake)
    np.random.seed(1000 * seed + int(100 * p_mistake))  # noqa: NPY002
    rows, acts, lengths, success = ([], []), [], [], []
    for m in range(n):
        observation, info = env.reset(seed=100_000 * seed + m)
        controller.reset(observation, info)
        for step in range(10_000):
            action = controller.select_action(observation, info)
            if controller.done:
                break
            for part, value in zip(rows, (observation, action), strict=True):
                part.append(np.asarray(value, dtype=np.float32))
            observation, _, is_terminal, is_late, info = env.step(action)
            if is_terminal or is_late:
                step += 1
                break
        controller.finish_episode(step - 1, info)
        acts += [(m, a["start"], a["end"] + 1, a["is_potential_high_level_mistake"]) for a in controller.segments]
        lengths.append(step)
        success.append(bool(env.unwrapped._success))
    arrays = {"observations": np.array(rows[0]), "actions": np.array(rows[1]), "acts": np.array(acts, dtype=int)}
    return arrays | {"offsets": np.append(0, np.cumsum(lengths)), "success": np.array(success)}


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for seed in SEEDS:
        for task in TASKS:
            for p_mistake in P_MISTAKE:
                path = folder / f"{task}_{p_mistake:g}_{seed}.npz"
                if not path.exists():
                    np.savez_compressed(path, **episodes(task, p_mistake, seed, EPISODES))
                    print(path.name, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
