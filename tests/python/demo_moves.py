"""How `artitwin demo` chains holds, on a joint without a world: what a hold reaches is given.

    python demo_moves.py MODULES

MODULES is src/run/demonstrate. Exits with 1 where a motion is not made of the holds that it should be made of.
"""

import sys
from types import SimpleNamespace

sys.path.insert(0, sys.argv[1])

import demo
import numpy as np
import stage
import twin


class World(stage.Stage):
    """A stage whose holds are those that `room` gives for a start and an end; one that is performed gets where `reach`
    says."""

    def __init__(self, room, reach=lambda start, goal: goal):
        self.at, self.room_for, self.reach = 0.0, room, reach
        self.robot = SimpleNamespace(away=lambda model, data: None)
        self.model = self.data = None

    def position(self, joint):
        return self.at

    def kept(self):
        return self.at

    def back(self, kept):
        self.at = kept

    def holds(self, joint, goal):
        for kind in self.room_for(self.at, goal):
            yield SimpleNamespace(kind=kind, tip=np.zeros(3), rotation=np.eye(3))

    def perform(self, joint, hold, goal):
        self.at = self.reach(self.at, goal)
        return {"hold": hold.kind, "share": self.share(joint)}

    def diverged(self):
        return False

    def put(self, joint, share):
        self.at = joint.at(share)


def joint(*recorded):
    return twin.Joint("door", "door", "hinge", 0.0, 2.0, 0.0, recorded)


def test_one_hold_where_it_has_room():
    world = World(lambda start, goal: ["grasp"])
    moved = world.move(joint(), 2.0, 6)
    assert (moved["hold"], moved["share"], moved["tries"], len(moved["legs"])) == ("grasp", 1.0, 1, 1), moved


def test_two_holds_where_none_has_room_all_along():
    world = World(lambda start, goal: ["grasp"] if goal - start <= 1.0 and start < 1.0 else ["push"] if start >= 1.0 else [])
    moved = world.move(joint(), 2.0, 6)
    assert (moved["hold"], moved["share"], len(moved["legs"])) == ("grasp, push", 1.0, 2), moved
    assert [leg["from"] for leg in moved["legs"]] == [0.0, 0.5], moved


def test_no_more_holds_where_none_gets_on():
    world = World(lambda start, goal: ["grasp"], lambda start, goal: min(goal, 1.0))
    moved = world.move(joint(), 2.0, 6)
    assert moved["share"] == 0.5 and len(moved["legs"]) == 1 and world.at == 1.0, moved
    assert World(lambda start, goal: []).move(joint(), 2.0, 6) is None


def test_a_hold_that_leads_back_is_undone():
    world = World(lambda start, goal: ["grasp"], lambda start, goal: 1.0 if start == 0.0 else start - 0.1)
    moved = world.move(joint(), 2.0, 6)
    assert moved["share"] == 0.5 and len(moved["legs"]) == 1 and world.at == 1.0, moved


def test_a_lid_without_a_hold_is_opened_from_where_it_was_recorded():
    room = lambda start, goal: ["grasp"] if start > 0.5 else []
    assert demo.open_up(World(room), joint(0.4, 0.8), 6)[0] == 0.4
    for none in (joint(), joint(0.05, 0.95), joint(0.95)):
        assert demo.open_up(World(room), none, 6) == (0.0, None)


for name, test in list(globals().items()):
    if name.startswith("test_"):
        test()
