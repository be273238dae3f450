"""The SUMO world: roads, background traffic and members, one step at a time.

What the calls rely on was found by experiment with SUMO 1.28; tests/sumo checks it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from types import MappingProxyType

import numpy as np

from platoontraffic.controllers import Signals
from platoontraffic.errors import RunError
from platoontraffic.road.network import Network
from platoontraffic.road.speed_profile import load as load_speed_profile
from platoontraffic.road.way_round_kernel import load as load_way_round
from platoontraffic.sumo.background import Background
from platoontraffic.sumo.client import Client, direct, libsumo
from platoontraffic.sumo.conflicts import load as load_conflicts
from platoontraffic.sumo.departures import in_the_way
from platoontraffic.sumo.first_on_lanes import FirstOnLanes
from platoontraffic.sumo.gridlock import Gridlock
from platoontraffic.sumo.lane_swaps import LaneSwaps
from platoontraffic.sumo.letting_go import LettingGo
from platoontraffic.sumo.letting_in import LettingIn
from platoontraffic.sumo.obstacles import HeldObstacles
from platoontraffic.sumo.passages import Passages
from platoontraffic.sumo.placement import Placement
from platoontraffic.sumo.placement_kernel import load as load_poses
from platoontraffic.sumo.process import Process, start_options
from platoontraffic.sumo.recruiting import Recruiting
from platoontraffic.sumo.shadows import shadow_options
from platoontraffic.sumo.stoplines import StopLines
from platoontraffic.sumo.trips import Trips
from platoontraffic.sumo.waiting_places import WaitingPlaces
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import Entry, departs_by, members_at, with_their_followers
from platoontraffic.world.passages import Passage
from platoontraffic.world.recruits import Recruits
from platoontraffic.world.traffic import PERSON, TrafficSnapshot
from platoontraffic.world.trips import Trip


class World:
    """SUMO from start to close, as the ground that members drive on (see `world.ground.Ground`).

    step    : [s], whole milliseconds
    words   : file to which SUMO's messages are appended
    options : more of SUMO's options, by their names without dashes: files to read and to write
    warm_up : background traffic drives alone for so long before members are deployed [s]
    client  : the SUMO to call; default: libsumo, in this process
    warm    : its SUMO goes on in this world, after its warm-up; default: a SUMO of its own
    recruits: vehicles of the traffic that become members; default: none do
    counted : edges at whose ends vehicles are counted
    """

    def __init__(
        self,
        network: Network,
        step: float,
        seed: int,
        words: Path,
        options: Mapping[str, str] = MappingProxyType({}),
        warm_up: float = 0.0,
        client: Client | None = None,
        warm: World | None = None,
        recruits: Recruits | None = None,
        counted: Sequence[str] = (),
    ) -> None:
        self._sumo: Client = client or libsumo
        options = {**options, **shadow_options(network, options)}
        self._options = start_options(network.path, step, seed, options)
        self._step, self._warm_up = step, warm_up
        self._warm = warm
        self._process = warm._process if warm else Process(self._sumo, network.path, words)
        self._background = Background(self._sumo, network)
        self._obstacles = HeldObstacles(self._sumo, network.drivable, self._background)
        self._placement = Placement(self._sumo, network, step)
        self._letting_go = LettingGo(self._sumo, network)
        self._letting_in, self._first_on_lanes = LettingIn(self._sumo, step, network), FirstOnLanes(self._sumo)
        self._lines = StopLines(network, self._sumo, self._letting_in, step)
        self._waiting_places = WaitingPlaces(self._sumo, step)
        self._trips = Trips(self._sumo, self._placement, step)
        self._passages = Passages(self._sumo, network, counted, self._trips)
        self._recruiting = recruits and Recruiting(self._sumo, recruits, step)
        self._lane_swaps = LaneSwaps(self._sumo)
        self._gridlock = recruits and Gridlock(self._sumo)
        self.gridlocked = False
        self._start = 0.0  # time 0 of the run, on SUMO's clock [s]
        self._clock = 0.0  # SUMO's, after the last step [s]
        self._later: list[Fleet] = []  # platoons that depart later, the next one first

    def __enter__(self) -> World:
        if not self._warm:
            self._process.start(self._options)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._process.close(error)

    @property
    def client(self) -> Client:
        return self._sumo

    def logs_in(self, folder: Path) -> None:
        """The file of SUMO's messages is in another folder now."""
        self._process.log = folder / self._process.log.name

    @property
    def waiting(self) -> Sequence[Fleet]:
        """Platoons that have not yet departed."""
        return self._later

    @property
    def expects_more(self) -> bool:
        """There may be further members: vehicles of the traffic are still to arrive or to depart."""
        held = len(self._obstacles.in_sumo)  # vehicles of SUMO's, too
        return bool(self._recruiting) and self._sumo.simulation.getMinExpectedNumber() > held

    @property
    def trips(self) -> list[Trip]:
        """Trips of members from the traffic."""
        return self._trips.rows()

    def deploy(self, fleet: Fleet, later: Sequence[Fleet] = ()) -> Fleet:
        """Insert members at their start poses; this is time 0.

        Background vehicles in their path are removed: a platoon appears, it does not drive in. Platoons that depart
        `later` wait for room instead: see `advance`.
        """
        self._later = sorted(later, key=lambda platoon: platoon.members[0].departs)
        if not self._warm:
            self.warm_up()
        self._placement.insert(fleet)
        self._simulate()
        departed = list(self._sumo.simulation.getDepartedIDList())
        for name in in_the_way(fleet, self.snapshot(fleet), self._sumo):
            if not name.startswith(PERSON):
                self._sumo.vehicle.remove(name)
        self.place(fleet)
        self._simulate()
        departed += self._sumo.simulation.getDepartedIDList()
        self._start = self._clock
        if self._recruiting:
            own = len(fleet) + sum(map(len, later))
            self._recruiting.begin(own, (name for name in departed if name not in fleet.row_of))
        return self._taken_over(fleet)

    def warm_up(self) -> None:
        """Let background traffic drive alone for its time; without another world that goes on, `deploy` does that."""
        if self._warm_up:
            self._process.step(self._sumo.simulation.getTime() + self._warm_up)

    def load_kernels(self, fleet: Fleet) -> None:
        """Load what is compiled for this world, so that forks of the process need not. Nothing moves."""
        self.snapshot(fleet, 1.0)
        load_poses()
        load_conflicts()
        load_speed_profile()
        load_way_round()

    def look_ahead(self, members: Sequence[Member]) -> None:
        """Find out about the junctions on members' routes, so that forks of the process need not. Nothing moves."""
        self._lines.look_ahead(members)

    def snapshot(self, fleet: Fleet, reach: float = np.inf) -> TrafficSnapshot:
        """Vehicles and people at this instant: members as the fleet has them, background traffic as SUMO does.

        reach: distance from a member's centre beyond which background traffic may be left out [m], if it comes to the
               same place as no member within `CONTACT_HORIZON`
        """
        time = self._time()
        background = self._background.traffic(fleet, reach, self._obstacles.in_sumo, time)
        traffic, obstacles = members_at(fleet, time).with_others(background), self._obstacles.bodies
        traffic = traffic.with_others(obstacles) if obstacles and obstacles.ids else traffic
        return traffic.on_levels(self._background.apart) if self._background.apart else traffic

    def refit(self, members: Mapping[str, Member]) -> None:
        """Platoons that wait depart with the laws and sensors of these members, by id."""
        self._later = [platoon.refitted(members, self._step) for platoon in self._later]

    def hold(self, obstacles: TrafficSnapshot, routes: Mapping[str, tuple[str, ...]]) -> None:
        """Obstacles at the end of the coming step, or now before the first.

        Those in `routes` are vehicles in SUMO while their centre is on the road, so that its drivers see them.
        Background vehicles that they overlap when they appear are removed.

        routes: edges, by obstacle, that it means to drive; there may be none
        """
        self._obstacles.hold(obstacles, routes, self._placement.where)

    def place(self, fleet: Fleet, brakes: np.ndarray | None = None, passed: Set[str] = frozenset()) -> None:
        """Tell SUMO the pose of every member at the end of the coming step.

        brakes: deceleration of members with a failed drive, (n,), NaN: sound [m/s2]; SUMO-driven ones are slowed by it
        passed: bodies that members drive round; vehicles of the traffic that stand there stay

        raises: RunError (a pose is not finite)
        """
        self._letting_go.observe(fleet, self._placement.where, self._clock)
        told = self._waiting_places.observe(self._lines.waiting_places, passed - self._placement.where.keys())
        unwilling = self._obstacles.in_sumo | told | self._lines.heedless
        where, wanted, obstacles = self._placement.where, self._lines.room_wanted, self._obstacles.in_sumo
        theirs = self._first_on_lanes.room_wanted(fleet.ids, where, self._clock)
        theirs = {name: theirs[name] for name in theirs if name not in obstacles}
        self._letting_in.observe({**wanted, **theirs}, where, unwilling, fleet.places)
        self._lane_swaps.observe(where, wanted, self._clock, obstacles)
        self._placement.place(fleet, brakes, self._lines.over_line)

    def advance(self, fleet: Fleet) -> Fleet:
        """One step of SUMO: the fleet after it.

        Members at the end of their routes are removed, and with a leader those of its followers that know no route. A
        platoon that is due departs as soon as there is room.
        """
        departing = self._departing(fleet) if self._later else []
        gone = fleet.arrived()
        native = {fleet.members[i].id for i in fleet.native_rows} if fleet.native_rows.size else set()
        self._simulate()
        removed_by_sumo = {*self._sumo.simulation.getArrivedIDList()} & native if native else set()
        if gone or removed_by_sumo:
            gone = with_their_followers(fleet, gone | removed_by_sumo)
            for name in sorted(gone - removed_by_sumo):
                self._sumo.vehicle.remove(name, self._sumo.constants.REMOVE_ARRIVED)
            self._trips.end(gone, round(self._time() - self._step, 6), "arrived")
            self._placement.forget(gone)
            fleet = fleet.without(gone)
        self._placement.locate(fleet)
        self._placement.put_in_order(fleet, self._clock)
        self._obstacles.settle()
        self._placement.settle(fleet)
        fleet = self._placement.read(fleet)
        self.gridlocked = bool(self._gridlock) and self._gridlock.observe(fleet, self._clock)
        for platoon in departing:
            self._later.remove(platoon)
            fleet = fleet.joined(self._taken_over(platoon))
        return self._lines.with_other_lanes(self._with_newcomers(fleet))

    def roads(self, fleet: Fleet) -> list[tuple[str, str]]:
        """Edge and lane of each member after the last step; the lane is "" off the road."""
        return self._placement.roads(fleet)

    def signals(self, fleet: Fleet) -> Signals | None:
        """State of the next stop line of each member with a law that needs it; None if no law does."""
        return self._lines.signals(fleet, self._placement.lanes(fleet))

    def entries(self, fleet: Fleet) -> list[Entry]:
        """Members that entered a junction in the last step; SUMO-driven ones are left out."""
        return self._lines.entries(fleet, self._placement.entries())

    def passages(self, fleet: Fleet) -> list[Passage]:
        """Vehicles that passed the end of a counted edge in the last step."""
        return self._passages.observe(fleet.ids, self._time()) if self._passages.counted else []

    def _departing(self, fleet: Fleet) -> list[Fleet]:
        """Platoons that are due at the end of the coming step and have room; they are inserted."""
        departing: list[Fleet] = []
        time = self._clock - self._start + self._step
        for platoon in departs_by(self._later, time, self._step):
            first = platoon.members[0]
            taken = {(m.edge, m.lane) for other in departing for m in other.members}  # a lane takes one platoon a step
            if (first.edge, first.lane) in taken or in_the_way(platoon, self.snapshot(fleet), self._sumo):
                continue
            self._placement.insert(platoon)
            departing.append(platoon)
        return departing

    def _with_newcomers(self, fleet: Fleet) -> Fleet:
        """The fleet with the vehicles of the traffic that have become members in the last step."""
        if not self._recruiting:
            return fleet
        self._trips.observe(fleet, self._time())
        found = self._recruiting.newcomers(self._time(), {*fleet.ids, *self._obstacles.in_sumo})
        if not found:
            return fleet
        kinds = map(self._sumo.vehicle.getTypeID, found.ids)
        self._trips.begin(found, kinds, self._recruiting.waits)
        return fleet.joined(self._placement.adopt(found))

    def without(self, fleet: Fleet, stuck: Mapping[str, str]) -> Fleet:
        """The fleet without members that are stuck: each is removed ("remove"), or SUMO drives it ("sumo_drives")."""
        for name, remedy in stuck.items():
            if remedy == "remove":
                self._trips.end([name], self._time(), "removed")
                self._sumo.vehicle.remove(name)
                self._placement.forget([name])
            else:
                self._trips.hand_over(name)
                self._placement.hand_back(fleet.members[fleet.row_of[name]], *self._trips.driver(name))
        return fleet.without(set(stuck))

    def _time(self) -> float:
        return round(self._clock - self._start, 6)

    def _taken_over(self, platoon: Fleet) -> Fleet:
        missing = {m.id for m in platoon.members} - set(self._sumo.vehicle.getIDList())
        if missing:
            names, log = ", ".join(sorted(missing)), self._process.log.name
            raise RunError(f"SUMO did not insert {names}; its messages are in {log}")
        return self._placement.take_over(platoon)

    def _simulate(self) -> None:
        self._process.step()
        self._clock = direct(self._sumo.simulation.getTime)()
        self._background.stepped(self._clock)
