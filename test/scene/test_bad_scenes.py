# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every rule that a scene can break: the error names key path, value and rule."""

import math

import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import scene_from_document
from scene.broken import place, problems_of

NAN, INF = math.nan, math.inf


def same(a, b):
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


# key path | value | words of the rule
ONE_VALUE = [
    ("forces", 1.0, "unknown key"),
    ("links[1].joint.dampin", 0.1, "unknown key"),
    ("hand.forse", [0, 0, 0], "unknown key"),
    ("format", "hapticmech-scene/9", "hapticmech-scene/1"),
    ("name", "five bar", "pattern"),
    ("name", "x" * 101, "at most 100 characters"),
    ("operational_points[0].name", "x" * 256, "at most 100 characters"),
    ("links[0].inertial.mass", "0b101", "valid number"),
    ("name", "five_bar\n", "pattern"),
    ("task_space", "flat", "'planar' or 'spatial'"),
    ("links[0].inertial.mass", -1.0, "greater than or equal to 0"),
    ("links[0].inertial.mass", NAN, "must be a finite number"),
    ("links[0].inertial.mass", INF, "must be a finite number"),
    ("links[0].inertial.mass", 1.1e30, "must not be above 1e+30 in size"),
    ("links[0].inertial.com[0]", -1e308, "must not be above 1e+30 in size"),
    ("links[0].inertial.mass", True, "valid number"),
    ("links[0].inertial.mass", "1.0", "valid number"),
    ("links[0].inertial.mass", None, "valid number"),
    ("links[0].inertial.mass", 10**400, "valid number"),
    ("links[0].inertial.com[2]", NAN, "must be a finite number"),
    ("links[0].inertial.inertia.izz", -0.1, "greater than or equal to 0"),
    ("links[0].joint.type", "hinge", "'revolute'"),
    ("links[0].joint.damping", -0.1, "greater than or equal to 0"),
    ("links[0].joint.armature", -1e-9, "greater than or equal to 0"),
    ("links[0].joint.axis", "001", "valid tuple"),
    ("links[0].joint.axis", [0, 0, 2.0], "must be a unit vector"),
    ("links[0].joint.axis", [0, 0, 0], "must be a unit vector"),
    ("links[2].parent", "link9", "parent must be 'world' or a link listed before"),
    ("links[1].parent", "link4", "parent must be 'world' or a link listed before"),
    ("links[1].parent", "link2", "parent must be 'world' or a link listed before"),
    ("links[0].joint.type", "fixed", "a link fixed to the world does not move"),
    ("links[3].name", "world", "'world' is the fixed root"),
    ("links[1].name", "link1", "names must be unique"),
    ("links[1].joint.name", "joint1", "names must be unique"),
    ("links", [], "at least 1 item"),
    ("operational_points", [], "at least 1 item"),
    ("operational_points[0].link", "world", "unknown frame: must be one of"),
    ("operational_points[0].link", "link9", "unknown frame: must be one of"),
    ("closures[0].kind", "glue", "'planar_pin'"),
    ("closures[0].a.link", "link9", "unknown frame: must be 'world' or one of"),
    ("closures[0].b.link", "link4", "two different links"),
    ("closures[0].active", 1, "valid boolean"),
    ("closures[0].latch_distance", 0.001, "only a closure with active: false can latch"),
    ("closures[0].latch_distance", 0.0, "greater than 0"),
    ("initial_state.q.elbow", 1.0, "unknown joint"),
    ("initial_state.v.elbow", 1.0, "unknown joint"),
    ("initial_state.q.joint1", [1.0, 2.0], "a revolute joint takes 1 number"),
    ("initial_state.q.joint1", NAN, "must be a finite number"),
    ("initial_state.q.joint1", True, "valid number"),
    ("initial_state.q.joint1", "1.9", "valid number"),
    ("simulation.period", 0.0, "greater than 0"),
    ("simulation.period", 0.2, "less than or equal to 0.1"),
    ("simulation.integrator", "euler", "'rk4'"),
    ("simulation.accuracy.tolerance", -1e-9, "greater than or equal to 0"),
    ("simulation.accuracy.tolerance", 1.1, "less than or equal to 1"),
    ("simulation.accuracy.tolerance", float("inf"), "finite number"),
    ("simulation.accuracy.tolerance", NAN, "finite number"),
    ("simulation.accuracy.max_substeps", 0, "greater than or equal to 1"),
    ("simulation.accuracy.max_substeps", 1025, "less than or equal to 1024"),
    ("simulation.accuracy.max_substeps", 4.0, "valid integer"),
    ("perception.s_off", 0.02, "must be above s_on"),
    ("perception.s_on", 1.0, "less than 1"),
    ("perception.dwell", -0.001, "greater than or equal to 0"),
    ("device.mass", 0.0, "greater than 0"),
    ("device.substeps", 0, "greater than or equal to 1"),
    ("device.substeps", True, "valid integer"),
    ("device.substeps", 4.0, "valid integer"),
    ("controller.joint_constraint.feedforward", 1.5, "less than or equal to 1"),
    ("controller.force_channel.hand", -0.5, "greater than or equal to 0"),
    ("controller.engagement_ramp", -0.1, "greater than or equal to 0"),
    ("experiment.duration", 0.0, "greater than 0"),
    # The plane
    ("links[0].joint.axis", [0, 1.0, 0], "revolute axes are along z"),
    ("links[1].joint.origin.rpy", [0.1, 0, 0], "roll = pitch = 0"),
    ("links[1].joint.type", "free", "use a planar joint"),
    ("links[1].joint.type", "spherical", "use a planar joint"),
]


@pytest.mark.parametrize(("path", "value", "rule"), ONE_VALUE)
def test_one_bad_value_is_named(planar, path, value, rule):
    place(planar, path, value)
    named = [p for p in problems_of(planar) if p.key_path == path and rule in p.rule]
    assert len(named) == 1
    given = tuple(value) if isinstance(named[0].value, tuple) else value
    assert same(named[0].value, given)


# Problems whose place, or whose reported value, is not simply what was set.
ELSEWHERE = [
    ("gravity", [0, -9.81], "gravity[2]", "missing"),
    ("gravity", [0, 0, -9.81], "gravity[2]", "gravity has no z part"),
    ("gravity", [0, 0, 0, 0], "gravity", "at most 3 items"),
    ("hand", {"force": [0, 0, 0]}, "hand", "kind"),
    ("hand", {"kind": "robot"}, "hand", "'constant_wrench', 'spring_damper'"),
    ("hand.force", [0, 0, 1.0], "hand", "the hand has x, y and turns about z only"),
    ("hand.torque", [1.0, 0, 0], "hand", "the hand has x, y and turns about z only"),
    ("links[1].joint", {"name": "j", "type": "prismatic", "axis": [0, 0, 1.0]},
     "links[1].joint.axis", "prismatic axes have no z part"),
    ("links[0].inertial.inertia", {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "ixy": 2.0},
     "links[0].inertial.inertia", "principal moments must not be negative"),
    ("links[0].inertial.mass", 0.0, "links[0].inertial.mass", "cannot have rotational inertia"),
    ("links[1].inertial", {"mass": 0.0, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}},
     "operational_points[0].metric", "give metric: {mass, length}"),
    ("closures[0].kind", None, "closures[0].kind", "'planar_pin'"),
]  # fmt: skip


SPATIAL = [
    ("links[6].inertial.inertia", {"ixx": 1.0, "iyy": 1.0, "izz": 2.1},
     "links[6].inertial.inertia", "must not exceed the sum of the other two"),
    ("hand.waypoints", [], "hand.waypoints", "at least 1 item"),
    ("hand.waypoints[1].time", 0.0, "hand.waypoints[1].time", "waypoint times must increase"),
    ("hand.waypoints[1].tiem", 0.0, "hand.waypoints[1].tiem", "unknown key"),
    ("links[1].joint.axis", [0, 0.999, 0], "links[1].joint.axis", "must be a unit vector"),
]  # fmt: skip


# What acts in joints, springs between points and rods.
ELEMENTS = [
    ("links[1].joint.locked", 1, "links[1].joint.locked", "valid boolean"),
    ("links[1].joint.stiffness", -1.0, "links[1].joint.stiffness", "greater than or equal to 0"),
    ("links[1].joint.friction_speed", 0.0, "links[1].joint.friction_speed", "greater than 0"),
    ("links[1].joint.limits", {"lower": 0.5, "upper": 0.5, "stiffness": 1.0},
     "links[1].joint.limits.upper", "must be above lower = 0.5"),
    ("links[1].joint.limits", {"lower": -0.5, "upper": 0.5, "stiffness": 1.0, "depth": 0.0},
     "links[1].joint.limits.depth", "greater than 0"),
    ("closures[0].kind", "rod", "closures[0].length", "a rod needs its length"),
    ("closures[0].length", 0.3, "closures[0].length", "only a rod has one"),
    ("springs", [{"name": "s", "a": {"link": "link9"}, "b": {"link": "world"}}],
     "springs[0].a.link", "unknown frame"),
    ("springs", [{"name": "s", "a": {"link": "link1"}, "b": {"link": "link1"}}],
     "springs[0].b.link", "a spring joins two different links"),
]  # fmt: skip


IN_SCENES = [("planar", *case) for case in ELSEWHERE + ELEMENTS]
IN_SCENES += [("spatial", *case) for case in SPATIAL]


@pytest.mark.parametrize(("scene", "path", "value", "where", "rule"), IN_SCENES)
def test_a_problem_is_named_where_it_is(request, scene, path, value, where, rule):
    document = request.getfixturevalue(scene)
    place(document, path, value)
    assert [p.key_path for p in problems_of(document) if rule in p.rule] == [where]


@pytest.mark.parametrize(
    ("kind", "q", "field", "rule"),
    [
        *(
            ("spherical", [0.0, 0.0, 0.0, 1.0], field, "only revolute and prismatic joints")
            for field in ("stiffness", "friction", "effort")
        ),
        ("free", [0.0] * 6 + [1.0], "armature", "not free ones"),
        ("planar", [0.0, 0, 1, 0], "armature", "not planar ones"),
    ],
)
def test_what_acts_in_a_joint_needs_one_coordinate_and_a_rotor_one_that_turns_or_slides(
    spatial, kind, q, field, rule
):
    spatial["links"][0]["joint"] = {"name": "joint1", "type": kind, field: 1.0}
    spatial["initial_state"]["q"]["joint1"] = q
    (problem,) = problems_of(spatial)
    assert problem.key_path == f"links[0].joint.{field}"
    assert rule in problem.rule


def test_a_locked_joint_has_a_position_and_no_rate(planar):
    planar["links"][1]["joint"]["locked"] = True
    planar["initial_state"]["q"]["joint2"] = 0.4
    planar["initial_state"]["v"] = {"joint2": 0.0}
    assert scene_from_document(planar).initial_state.q["joint2"] == 0.4
    planar["initial_state"]["v"] = {"joint2": 0.1}
    (problem,) = problems_of(planar)
    assert (problem.key_path, problem.value) == ("initial_state.v.joint2", 0.1)
    assert "locked" in problem.rule


def test_a_scene_in_which_all_joints_are_locked_is_refused(planar):
    for link in planar["links"]:
        link["joint"]["locked"] = True
    names = ", ".join(link["joint"]["name"] for link in planar["links"])
    (rule,) = [p.rule for p in problems_of(planar) if p.key_path == "links"]
    assert rule.startswith("at least one joint must move; locked, ")
    assert rule.endswith(f" are {names}")


def test_a_planar_pin_needs_the_plane(spatial):
    frames = {"a": {"link": "hand"}, "b": {"link": "world"}}
    spatial["closures"] = [{"name": "pin", "kind": "planar_pin", **frames}]
    assert [p.key_path for p in problems_of(spatial)] == ["closures[0].kind"]


def test_closures_and_points_have_names_of_their_own(planar):
    planar["closures"] *= 2
    planar["operational_points"] *= 2
    keys = [p.key_path for p in problems_of(planar)]
    assert keys == ["closures[1].name", "operational_points[1].name"]


@pytest.mark.parametrize(
    ("kind", "good", "bad"),
    [
        ("spherical", [0.0, 0.0, 0.6, 0.8], [0.0, 0.0, 0.6, 0.9]),
        ("free", [1, 2, 3, 0.0, 0.0, 0.6, 0.8], [1, 2, 3, 0.0, 0.0, 0.0, 0.0]),
        ("planar", [1, 2, 0.6, 0.8], [1, 2, 1.0, 1.0]),
    ],
)
def test_orientations_have_unit_length_and_the_right_size(spatial, kind, good, bad):
    spatial["links"][0]["joint"]["type"] = kind
    spatial["initial_state"]["q"]["joint1"] = good
    assert scene_from_document(spatial).initial_state.q["joint1"] == tuple(good)
    for value, rule in ((bad, "unit length"), (good[1:], "number(s) here"), (0.2, "number(s)")):
        spatial["initial_state"]["q"]["joint1"] = value
        (problem,) = problems_of(spatial)
        assert problem.key_path == "initial_state.q.joint1"
        assert rule in problem.rule


def test_a_missing_key_is_named_and_not_the_whole_mapping_around_it(planar):
    del planar["links"][2]["inertial"]
    (problem,) = problems_of(planar)
    assert problem.key_path == "links[2].inertial"
    assert problem.rule == "required key is missing"
    assert problem.value is None


def test_a_name_that_is_none_is_named(planar):
    planar["initial_state"]["q"]["big toe"] = 1.9
    (problem,) = problems_of(planar)
    assert (problem.key_path, problem.value) == ("initial_state.q.big toe", "big toe")


def test_all_problems_are_listed_not_only_the_first(planar):
    place(planar, "links[0].inertial.mass", -1.0)
    place(planar, "device.mass", NAN)
    place(planar, "colour", "red")
    keys = {p.key_path for p in problems_of(planar)}
    assert keys == {"links[0].inertial.mass", "device.mass", "colour"}


@pytest.mark.parametrize("document", [None, [], "five_bar", 3])
def test_a_scene_is_a_mapping(document):
    (problem,) = problems_of(document)
    assert problem.key_path == "<root>"
    assert problem.value == document


BAD_FILES = [
    (b"name: a\nname: b\n", "line 2", "duplicate key"),
    (b"links: [{name: a", "line 1", "not valid YAML"),
    (b"- 1\n- 2\n", "<root>", "mapping"),
    (b"", "<root>", "mapping"),
    (b"a: 1\n---\nb: 2\n", "line 2", "not valid YAML"),
    (b"a: *nowhere\n", "line 1", "not valid YAML"),
    (b"a: !!python/object:os.system x\n", "line 1", "not valid YAML"),
    (b"a: !!int x\n", "line 1", "not valid YAML"),
    (b"a: " + b"9" * 401, "line 1", "at most 400 characters"),
    (b"? [a]\n: 1\n", "line 1", "a key is text or a number"),
    (b"a: 1\n<<: 3\n", "line 2", "only mappings can be merged"),
    (b"a: \xff\n", "file", "cannot be read"),
    (b"a: \x00\n", "file", "cannot be read"),
    (b"a: " + b"[" * 600 + b"]" * 600, "line 1", "nested too deeply"),
    (b"a: 1\nb: &a [*a]\n", "line 2", "aliases"),
    (b"a:\n" + b"- x\n" * 200_001, "line 200001", "at most 200000 values"),
    (b"#" * 4_000_001, "file", "at most 4000000 bytes"),
]


@pytest.mark.parametrize(("text", "where", "rule"), BAD_FILES)
def test_a_bad_file_is_refused_by_name(tmp_path, text, where, rule):
    path = tmp_path / "bad.yaml"
    path.write_bytes(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert caught.value.source == str(path)
    (problem,) = caught.value.problems
    assert problem.key_path == where
    assert rule in str(problem)


ALIASES = "a{}: &a{} [{}]"
MERGES = "a{}: &a{} {{<<: [{}]}}"


@pytest.mark.parametrize(
    ("first", "line"),
    [("[x, x, x]", ALIASES), ("{x: 1, y: 2}", MERGES), ("{x: 1, y: 2}", ALIASES)],
    ids=["lists", "merges", "mappings"],
)
def test_a_short_file_cannot_alias_its_way_to_billions_of_values(tmp_path, first, line):
    lines = [f"a0: &a0 {first}"]
    lines += [line.format(i, i, ", ".join([f"*a{i - 1}"] * 10)) for i in range(1, 12)]
    path = tmp_path / "bomb.yaml"
    path.write_text("\n".join(lines))
    with pytest.raises(SceneError, match="aliases written out"):
        load_scene(path)


@pytest.mark.parametrize("name", ["x" * 300, "x" * 5000, "a\0b", "/dev/zero"])
def test_a_name_that_no_file_can_have_is_no_scene(name):
    with pytest.raises(SceneError, match="no such file, nor a shipped scene"):
        load_scene(name)


def test_an_unknown_scene_lists_those_there_are(tmp_path):
    with pytest.raises(SceneError, match="five_bar"):
        load_scene("six_bar")
    with pytest.raises(SceneError, match="no such file"):
        load_scene(tmp_path)
