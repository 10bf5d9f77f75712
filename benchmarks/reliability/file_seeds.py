# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Good files of every kind that the package reads, which mutants are made of."""

from __future__ import annotations

import json
import struct
from pathlib import Path

from rosbags.typesys import Stores, get_typestore

from benchmarks.children import ROOT
from hapticmech_ros.bag import BagWriter

JSON_SCENE = {
    "format": "hapticmech-scene/1",
    "model": "MODEL",
    "shapes": [{"name": "floor", "link": "world", "geometry": {"kind": "half_space"}}],
}
INERTIAL = '<inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
MJCF = f"""<mujoco model="m"><compiler angle="radian"/><option gravity="0 0 -9.81"/>
<default><joint damping="0.1"/><default class="a"><geom size="0.1"/></default></default>
<worldbody><body name="a" pos="0 0 1">{INERTIAL}<joint name="ja" type="hinge" axis="0 0 1"
range="-1 1" limited="true"/><geom name="g" class="a" type="sphere" size="0.05"/>
<body name="b" pos="0.2 0 0" euler="0 0.1 0">{INERTIAL}<joint name="jb" type="slide" axis="1 0 0"/>
<site name="s" pos="0.1 0 0"/></body></body><body name="c" pos="0.2 0 0">{INERTIAL}
<joint name="jc" axis="0 0 1"/></body></worldbody>
<equality><connect body1="b" body2="c" anchor="0.2 0 0" active="false"/>
<joint joint1="ja" joint2="jc" polycoef="0 1 0 0 0"/></equality></mujoco>"""
SDF_LINK = """<link name="{0}"><pose>{1} 0 0 0 0 0.1</pose><inertial><mass>1.5</mass><inertia>
<ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia></inertial><collision name="c{0}"><geometry>
<box><size>0.1 0.2 0.3</size></box></geometry></collision></link>"""
SDF_JOINT = """<joint name="{0}" type="revolute"><parent>{1}</parent><child>{2}</child><axis>
<xyz>0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit><dynamics><damping>0.1</damping>
</dynamics></axis></joint>"""
SDF = (
    '<?xml version="1.0"?><sdf version="1.9"><model name="m">'
    f'<frame name="f" attached_to="a"><pose>0.1 0 0 0 0 0</pose></frame>'
    f"{SDF_LINK.format('a', 0.1)}{SDF_LINK.format('b', 0.3)}"
    f"{SDF_JOINT.format('j1', 'world', 'a')}{SDF_JOINT.format('j2', 'a', 'b')}</model></sdf>"
)
CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
TRIANGLES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
DAE = f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="12">{" ".join(str(x) for c in CORNERS for x in c)}
</float_array><technique_common><accessor source="#f" count="4" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#s"/>
</vertices><triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{" ".join(str(x) for t in TRIANGLES for x in t)}</p></triangles></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="w"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""
SCRIPT = "time,fx,fy,fz,tx,ty,tz\n" + "".join(
    f"{k * 0.1:.1f},{k},0,0.5,0,0,-1e-2\n" for k in range(60)
)
PARAMETERS = """haptic_device:
  ros__parameters:
    scene: five_bar
    hand_timeout: 0.4
    autostart: true
    names: [a, b]
/**:
  ros__parameters: {control_rate: 500.0, steps: [1, 2, 3]}
"""


def write_seeds(folder: Path) -> dict[str, list[Path]]:
    """Write good files into a folder; return them by kind.

    A kind is what reads it: see ``file_worker``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scenes = sorted((ROOT / "config" / "scenes").glob("*.yaml"))
    found = {
        "scene": scenes,
        "urdf": [ROOT / "examples" / "pantograph.urdf"],
        "xml": [_text(folder / "model.xml", MJCF)],
        "sdf": [_text(folder / "model.sdf", SDF)],
        "sidecar": [ROOT / "examples" / "pantograph.yaml"],
        "csv": [_text(folder / "script.csv", SCRIPT)],
        "mesh": _meshes(folder),
        "parameters": [_text(folder / "parameters.yaml", PARAMETERS)],
        "mcap": [],
        "db3": [],
        "metadata": [],
    }
    for storage, suffix in (("mcap", "mcap"), ("sqlite3", "db3")):
        bag = _bag(folder / storage, storage)
        found[suffix] += list(bag.glob(f"*.{suffix}"))
        found["metadata"].append(bag / "metadata.yaml")
    return found


def _text(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def _meshes(folder: Path) -> list[Path]:
    stl = bytes(80) + struct.pack("<I", len(TRIANGLES))
    for triangle in TRIANGLES:
        stl += bytes(12) + b"".join(struct.pack("<3f", *CORNERS[k]) for k in triangle) + bytes(2)
    (folder / "body.stl").write_bytes(stl)
    points = [" ".join(map(str, corner)) for corner in CORNERS]
    faces = [" ".join(str(k + 1) for k in triangle) for triangle in TRIANGLES]
    obj = "\n".join([*(f"v {p}" for p in points), *(f"f {f}" for f in faces)])
    counted = [f"3 {' '.join(map(str, triangle))}" for triangle in TRIANGLES]
    off = "\n".join(["OFF", "4 4 0", *points, *counted, ""])
    return [
        folder / "body.stl",
        _text(folder / "body.obj", obj),
        _text(folder / "body.off", off),
        _text(folder / "body.dae", DAE),
    ]


def _bag(path: Path, storage: str) -> Path:
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "std_msgs/msg/Float64"
    with BagWriter(path, storage) as bag:
        bag.add_topic("/a", kind)
        bag.add_topic("/b", "std_msgs/msg/String", "latched")
        for number in range(40):
            message = store.types[kind](float(number))
            bag.write("/a", 10**9 + number * 10**6, bytes(store.serialize_cdr(message, kind)))
            if number % 10 == 0:
                bag.write("/b", 10**9 + number, b"\0\1\0\0\3\0\0\0hi\0")
                bag.flush()
    return path


def sidecar(model: str) -> str:
    """Return a scene file beside a model."""
    return json.dumps({**JSON_SCENE, "model": model})
