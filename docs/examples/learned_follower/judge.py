"""The learned follower beside `repaired` on drives that it was not trained on: `python judge.py [RESULTS]`.

A seed draws where and in which direction of `lab_curves` the two robots start, their distance, the leader's speed and
its profile, the size of the errors of the follower's laser, and these errors. Both laws drive all of them.

`cross_track_rms` ends where a follower is split off, so that a law which loses its predecessor early looks good by it;
`path_rms` is the same over the instants at which both laws see their predecessor, and empty where there is none.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

import platoontraffic

HERE = Path(__file__).parent
SEEDS = range(101, 111)
LENGTHS = ({"n_w": 7.8, "w_s": 3.3, "s_e": 9.9, "e_n": 6.4}, {"n_e": 4.9, "e_s": 8.3, "s_w": 1.7, "w_n": 6.2})  # [m]
METRICS = ("cross_track_rms", "cross_track_max", "lock_on_ratio", "gap_mean", "gap_error_rms")
LAWS = {"learned": ("policy", f"platoon.follower.file={HERE / 'follower.npz'}"), "repaired": ("repaired",)}


def drive(seed: int) -> dict[str, object]:
    """Keys of the scenario that a seed draws."""
    random = np.random.default_rng(seed)
    lengths = LENGTHS[int(random.integers(2))]
    edge = str(random.choice(list(lengths)))
    position = random.uniform(1.2, lengths[edge])
    speed, profile = random.uniform(0.1, 0.5), str(random.choice(["constant", "sinusoid", "step"]))
    keys: dict[str, object] = {
        "platoon.route": list(lengths),
        "platoon.start": f'{{edge="{edge}", position_m={position:.2f}}}',
        "platoon.gap_m": round(random.uniform(0.4, 0.6), 2),
        "platoon.leader.speed_mps": round(speed, 3),
        "platoon.follower.lidar.noise.sigma_m": float(f"{np.exp(random.uniform(np.log(0.001), np.log(0.02))):.2g}"),
    }
    if profile == "sinusoid":
        more = {"amplitude_mps": round(0.4 * speed, 3), "frequency_hz": round(1 / random.uniform(4, 12), 3)}
    else:
        more = {"last_speed_mps": round(0.3 * speed, 3), "begins_s": round(random.uniform(5, 20), 1)}
    if profile != "constant":
        keys |= {f"platoon.leader.{key}": value for key, value in ({"profile": profile} | more).items()}
    return keys


def driven(keys: dict[str, object], law: str, results: Path, seed: int = 1) -> platoontraffic.analysis.Results:
    """A run of 40 s of a leader and one follower."""
    name, *more = LAWS[law]
    changes = ["platoon.size=2", "run.duration_s=40", f"platoon.follower.law={name}", *more]
    changes += [f"{key}={value}" for key, value in keys.items()]
    return platoontraffic.run(HERE / "learned_follower.toml", *changes, seed=seed, results=results)


def judged(drives: dict[object, dict[str, object]], results: Path) -> pd.DataFrame:
    """Metrics of the follower, a row for each drive and law. The seed of a drive is its name, if that is a number."""
    rows = []
    for name, keys in drives.items():
        runs = {law: driven(keys, law, results, name if isinstance(name, int) else 1) for law in LAWS}
        paths = [run.trajectories.query("vehicle_id == 'robot.1'").set_index("time_s") for run in runs.values()]
        both = pd.concat([path.cross_track_m.where(path.beams_on_predecessor > 0) for path in paths], axis=1)
        errors = np.sqrt((both.dropna() ** 2).mean()).to_numpy()
        for law, error in zip(LAWS, errors, strict=True):
            metrics = runs[law].metrics
            own = metrics[metrics.vehicle_id == "robot.1"].set_index("metric").value.astype(float)
            rows.append({"drive": name, "law": law, "path_rms": error} | {m: own.get(m, np.nan) for m in METRICS})
    return pd.DataFrame(rows).set_index(["drive", "law"])


def wins(table: pd.DataFrame) -> str:
    """How many of the drives the learned law wins."""
    path, lock = (table[metric].unstack() for metric in ("path_rms", "lock_on_ratio"))
    nearer, kept = path.learned < path.repaired, lock.repaired == 1
    return (
        f"{len(path)} drives: longer locked on {(lock.learned > lock.repaired).sum()}, "
        f"less long on {(lock.learned < lock.repaired).sum()}\n"
        f"nearer to the predecessor's path, while both see it, on {nearer.sum()} of {len(path.dropna())}; "
        f"where `repaired` never loses it, on {nearer[kept].sum()} of {kept.sum()}"
    )


def drives(seeds: Iterable[int] = SEEDS) -> dict[object, dict[str, object]]:
    return {seed: drive(seed) for seed in seeds}


def main() -> None:
    results = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("results")
    table = judged(drives(), results)
    shown = pd.DataFrame(drives()).T.rename(columns=lambda key: key.removeprefix("platoon.")).drop(columns="route")
    print(shown.fillna("").to_string(), "", table.round(4).to_string(), "", wins(table), sep="\n")


if __name__ == "__main__":
    main()
