"""Laws in a file beside the scenario: their declarations, and the effects of these."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from platoontraffic import Decision, Twist, per_vehicle, scenario, shipped
from platoontraffic.controllers import Law, Sensed
from platoontraffic.controllers.registry import find_law
from platoontraffic.errors import InputError
from tests.support.runs import run

EVERY_NEED = "leader, leads, members, messages, route, signals, truth"

FILE = """
from dataclasses import dataclass
import numpy as np
from platoontraffic import Decision, Drive, Law, Twist

@dataclass(frozen=True)
class Plain:
    \"\"\"Stands still.\"\"\"

    gap_m: float = 0.4

    def __call__(self, sensed, memory, dt):
        assert sensed.route is None and sensed.signals is None and sensed.leads is None
        return Decision(Twist(0.0, 0.0))

@dataclass(frozen=True)
class Wishing(Plain):
    def desired_distance(self, speed):
        return self.gap_m + speed

@dataclass(frozen=True, slots=True)
class Slotted:
    gap_m: float = 0.4

    def __call__(self, sensed, memory, dt):
        return Decision(Twist(0.0, 0.0))

@dataclass(frozen=True)
class Alone(Law):
    \"\"\"Steers along its route, and stands while it is ordered to lead.\"\"\"

    needs = frozenset({"route", "leads"})
    drives_alone = True

    def __call__(self, sensed, memory, dt):
        return Decision(Drive(np.where(sensed.leads, -1.0, 1.0), sensed.route.curvature[:, 0]))
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.py").write_text(FILE)
    return tmp_path


@pytest.mark.parametrize("name", ["Plain", "Wishing", "Slotted"])
def test_a_class_that_does_not_derive_from_law_gets_its_defaults_and_keeps_its_name(folder, name):
    kind = find_law(f"mine:{name}", folder).kind
    law = kind(gap_m=0.5)
    assert isinstance(law, Law)
    assert (law.gap_m, law.needs, law.lidar, law.native, law.drives_alone) == (0.5, frozenset(), None, False, False)
    assert (law.hardest_braking, law.remembered_path(None)) == (np.inf, None)
    assert repr(law) == f"{name}(gap_m=0.5)"
    assert law == kind(gap_m=0.5)
    assert hash(law) == hash(kind(gap_m=0.5))
    assert (kind.__name__, kind.__module__[:5]) == (name, "mine_")


def test_a_class_that_derives_from_law_is_taken_as_it_is(folder):
    assert find_law("mine:Alone", folder).kind.__mro__[1] is Law


def changed(folder, name: str, follower: str, more: str = ""):
    """A shipped scenario with another follower."""
    lines = shipped.scenarios()[name].read_text(encoding="utf-8").split("[[manoeuvre]]")[0].splitlines()
    lines = [f"follower = {{ {follower} }}" if line.startswith("follower =") else line for line in lines]
    file = folder / "mine.toml"
    file.write_text("\n".join(lines) + more, encoding="utf-8")
    return file


def with_law(scenario_file, law: str):
    return scenario_file(('law = "repaired"', f'law = "{law}"'))


@pytest.mark.sumo
def test_a_law_that_declares_its_desired_distance_gets_a_gap_error(scenario_file, folder):
    errors = {}
    for law in ("mine:Plain", "mine:Wishing"):
        folder_of_run = run(folder / law, with_law(scenario_file, law), "run.duration_s=1", "platoon.size=2")
        rows = pd.read_csv(folder_of_run / "trajectories.csv").query("place == 1")
        errors[law] = rows.gap_error_m.to_numpy()
    assert np.isnan(errors["mine:Plain"]).all()
    assert np.isfinite(errors["mine:Wishing"]).all()


SPLIT = '\n[[manoeuvre]]\nkind = "split"\nvehicle = "platoon.2"\ntime_s = 5.0\n'


def test_only_a_law_that_drives_alone_can_be_given_a_manoeuvre(folder):
    scenario.load(changed(folder, "corridor_manoeuvres", 'law = "mine:Alone", lidar = "car-tracker"', SPLIT))
    with pytest.raises(InputError) as caught:
        scenario.load(changed(folder, "corridor_manoeuvres", 'law = "mine:Plain", lidar = "car-tracker"', SPLIT))
    (fault,) = caught.value.faults
    assert "'platoon.2': platoon.0.follower cannot drive alone; must be a law that declares drives_alone" in fault


@pytest.mark.sumo
def test_a_law_that_needs_it_is_given_the_order_to_lead(folder):
    file = changed(folder, "corridor_manoeuvres", 'law = "mine:Alone", lidar = "car-tracker"', SPLIT)
    rows = pd.read_csv(run(folder / "run", file, "run.duration_s=7", "record.every_s=1") / "trajectories.csv")
    acceleration = rows[rows.vehicle_id == "platoon.2"].set_index("time_s").accel_mps2
    assert acceleration[4.0] > 0.5
    assert acceleration[7.0] < -0.5


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        (
            'needs = "route"',
            f"Bad declares needs = 'route'; must be a set of names: {EVERY_NEED}",
        ),
        (
            "needs = None",
            f"Bad declares needs = None; must be a set of names: {EVERY_NEED}",
        ),
        ('needs = {"route", "lead"}', f"Bad needs lead; there is: {EVERY_NEED}"),
        ('needs = {"leads"}; drives_alone = True', "Bad declares drives_alone; then it must also need route"),
        ("desired_distance = 3.0", "Bad: desired_distance, remembered_path and braking_for must be methods"),
        ("hardest_braking = -3.0", "Bad declares hardest_braking = -3.0; must be more than 0 m/s2"),
        ("native = True", "Bad declares native; then it must also have max_speed and speed_factor"),
        (
            "native = True; max_speed = 30.0; speed_factor = None",
            "Bad declares native and speed_factor = None; must be a number more than 0",
        ),
    ],
)
def test_a_wrong_declaration_is_reported_in_one_line(scenario_file, folder, declared, said):
    with (folder / "mine.py").open("a") as file:
        file.write(f"\n@dataclass(frozen=True)\nclass Bad(Plain):\n    {declared}\n")
    with pytest.raises(InputError) as caught:
        scenario.load(with_law(scenario_file, "mine:Bad"))
    (fault,) = caught.value.faults
    assert fault.startswith(f"{folder / 'mine.toml'}:21: platoon.0.follower.law: ")
    assert fault.endswith(said)


def test_files_that_gains_name_are_sources_in_nested_tables_too(scenario_file, folder):
    with (folder / "mine.py").open("a") as file:
        file.write(
            "\nfrom pathlib import Path\n"
            "\n@dataclass(frozen=True)\nclass Inner:\n    map: Path | None = None\n"
            "\n@dataclass(frozen=True)\nclass Outer(Plain):\n"
            "    table: Path | None = None\n    inner: Inner = Inner()\n"
        )
    gains = 'mine:Outer"\ntable = "a.csv"\ninner.map = "b.csv'
    made = scenario.load(with_law(scenario_file, gains))
    assert set(made.sources) == {folder / name for name in ("mine.py", "a.csv", "b.csv")}


@pytest.mark.sumo
def test_an_error_in_a_class_that_does_not_derive_from_law_is_reported_at_its_own_line(scenario_file, folder):
    (folder / "mine.py").write_text(FILE.replace("return self.gap_m + speed", "return 1 / 0"))
    with pytest.raises(InputError, match=r"mine.py:19: law Wishing failed in desired_distance\(0\): ZeroDivisionError"):
        run(folder / "run", with_law(scenario_file, "mine:Wishing"), "run.duration_s=1", "platoon.size=2")


@pytest.mark.sumo
@pytest.mark.parametrize("method", ["braking_for", "remembered_path", "looks_along"])
def test_an_error_in_another_method_of_a_law_is_reported_too(folder, method):
    """It was an unexpected error of the tool."""
    with (folder / "mine.py").open("a") as file:
        file.write(
            "\n@dataclass(frozen=True)\nclass Faulty(Alone):\n"
            "    def __call__(self, sensed, memory, dt):\n"
            "        return super().__call__(sensed, memory, dt)._replace(memory=0 * sensed.speed)\n"
            f"    def {method}(self, *given):\n        return 1 / 0\n"
        )
    file = changed(folder, "corridor_manoeuvres", 'law = "mine:Faulty", lidar = "car-tracker"', "")
    with pytest.raises(InputError, match=f"mine.py:[0-9]+: law Faulty failed in {method}: ZeroDivisionError"):
        run(folder / "run", file, "run.duration_s=1", "record.scans_every_s=0.5")


@pytest.mark.parametrize(
    "given",
    [
        None,
        (0.1, 0.0),
        Decision((0.1, 0.0)),
        Decision(Twist(np.zeros(3), 0.0)),
        Decision(Twist(0.1, 0.0), target=2.5),  # with two vehicles 2.5 and 2.5 would be taken for one target
        Decision(Twist(0.1, 0.0), target=(2.5, 0.0, 0.0)),
    ],
)
def test_what_is_no_decision_of_one_vehicle_is_named(given):
    law = per_vehicle(lambda self, sensed, memory, dt: given)
    with pytest.raises(TypeError, match="to one vehicle; must be a Decision of a Twist, or a Drive, and a Target"):
        law(None, Sensed(None, np.zeros(2), np.zeros(2)), None, 0.1)
