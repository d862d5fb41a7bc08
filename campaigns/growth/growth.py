"""Growth of a population: the system under test of this campaign. Standard library only.

    python3 growth.py --growth-rate 0.5 --initial-population 10

Writes growth.csv with the columns t_s and population. The model is integrated by Euler's method with a fixed step,
which is its fault: where growth rate × step comes near 1 and beyond, a population that should approach the capacity
from below jumps over it.
"""

import argparse
import csv
import math


def grown(population: float, growth_rate: float, step_s: float, capacity: float) -> float:
    """The population one step later; an infinite capacity makes the growth exponential."""
    return population + growth_rate * population * (1.0 - population / capacity) * step_s


def main() -> None:
    """Read the arguments, grow, write the table."""
    parser = argparse.ArgumentParser(description="Growth of a population.")
    parser.add_argument("--growth-rate", type=float, required=True, help="per second")
    parser.add_argument("--initial-population", type=float, required=True)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--step-s", type=float, default=0.5)
    parser.add_argument("--model", choices=["logistic", "exponential"], default="logistic")
    parser.add_argument("--capacity", type=float, default=1000.0, help="of the logistic model")
    arguments = parser.parse_args()
    if arguments.initial_population <= 0:
        parser.error(f"expected more than 0, got --initial-population {arguments.initial_population:g}")
    capacity = arguments.capacity if arguments.model == "logistic" else math.inf

    population = arguments.initial_population
    with open("growth.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["t_s", "population"])
        table.writerow([0.0, population])
        for step in range(1, arguments.steps + 1):
            population = grown(population, arguments.growth_rate, arguments.step_s, capacity)
            table.writerow([step * arguments.step_s, population])
    print(f"{population:.1f} after {arguments.steps} steps of {arguments.step_s:g} s")


if __name__ == "__main__":
    main()
