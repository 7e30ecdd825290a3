"""The forty drives of the README: python tools/drives.py writes drives.csv into the current folder.

Each drive is of another driver, P01 to P40: forty seconds at ten steps a second in a lane with curves. Four drivers are
reckless (P08, P28, P37, P38) and two lazy (P23, P24). In P17 the sensor of the lane freezes after fifteen seconds.
"""

from __future__ import annotations

import csv
import math
import random
from collections.abc import Iterator

HEADER = ["participant", "time_s", "lane_offset_m", "heading_deg", "speed_kmh", "curve_deg", "steering_deg", "pedal"]
RECKLESS, LAZY, FROZEN = {8, 28, 37, 38}, {23, 24}, 17
N_DRIVES, N_STEPS, PER_SECOND = 40, 400, 10


def rows() -> Iterator[list[object]]:
    rng = random.Random(2)
    for number in range(1, N_DRIVES + 1):
        lane, heading, speed, steering = rng.gauss(0, 0.3), 0.0, rng.uniform(60, 70), 0.0
        phase, gain = rng.uniform(0, 6), rng.uniform(0.9, 1.1)
        wanted, tremor = (95.0, 3.0) if number in RECKLESS else (65.0, 0.5)
        seen = lane
        for step in range(N_STEPS):
            curve = 4 * math.sin(step / 40 + phase)
            if number not in LAZY or step % 15 == 0:
                steering = curve - gain * (3 * lane + heading) * (0.4 if number in RECKLESS else 1)
            steering += rng.gauss(0, tremor)
            pedal = min(max((wanted - speed) / 20 + rng.gauss(0, 0.03), -1), 1)
            if number != FROZEN or step < 15 * PER_SECOND:
                seen = lane + rng.gauss(0, 0.01)
            measured = (step / PER_SECOND, seen, heading, speed, curve, steering, pedal)
            yield [f"P{number:02}", *(round(value, 3) for value in measured)]
            heading += (steering - curve + rng.gauss(0, 0.2)) / PER_SECOND
            lane += speed / 3.6 * math.radians(heading) / PER_SECOND
            speed += 8 * pedal / PER_SECOND


def main() -> None:
    with open("drives.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([HEADER, *rows()])


if __name__ == "__main__":
    main()
