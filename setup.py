# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Packaging for pip and for colcon. Version, maintainer and licence come from package.xml."""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "hapticmech_ros"
SHARE = f"share/{PACKAGE}"
EXECUTABLES = [
    "haptic_device",
    "haply_device",
    "relay_device",
    "robot_follower",
    "simulated_robot",
    "mechanism_simulator",
    "nullspace_analyser",
    "teleoperation_controller",
    "scene_viewer",
    "live_page",
    "composed",
]

DOCS = ["furo>=2025.7.19", "myst-parser>=4", "sphinx>=8"]
MJCF = ["mujoco>=4"]
LIVE = ["viser>=1.1", *MJCF]
CLUSTER = ["distributed>=2024.5"]
HAPLY = ["websockets>=13"]
PSUTIL = "psutil>=5.9"

HERE = Path(__file__).resolve().parent
MANIFEST = ElementTree.parse(HERE / "package.xml").getroot()


def stated(tag):
    """Return the text of ``tag`` in package.xml on one line."""
    return " ".join(MANIFEST.findtext(tag).split())


def shared(folder, pattern):
    """Return data_files entries that install files under ``folder`` below share/<package>/."""
    found = {}
    for path in sorted(HERE.glob(f"{folder}/**/{pattern}")):
        source = path.relative_to(HERE)
        found.setdefault(f"{SHARE}/{source.parent.as_posix()}", []).append(source.as_posix())
    return list(found.items())


def long_description():
    """Return the README, for the package's page on an index."""
    readme = HERE / "README.md"
    return readme.read_text(encoding="utf-8") if readme.exists() else stated("description")


setup(
    name=PACKAGE,
    version=stated("version"),
    description=stated("description"),
    long_description=long_description(),
    long_description_content_type="text/markdown",
    maintainer=stated("maintainer"),
    maintainer_email=MANIFEST.find("maintainer").get("email"),
    license=stated("license"),
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    # Of `make wheel`: compiled kernels.
    package_data={PACKAGE: ["py.typed", "compilation/*.zip"]},
    zip_safe=False,
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (SHARE, ["package.xml"]),
        *shared("config", "*.yaml"),
        *shared("config", "*.xml"),
        *shared("config", "*.rviz"),
        *shared("config", "*.json"),
        *shared("launch", "*.py"),
        # `ros2 run` looks in lib/<package>/; pip puts scripts in bin/ only, so these start those.
        (f"lib/{PACKAGE}", [f"resource/executables/{name}" for name in EXECUTABLES]),
    ],
    entry_points={
        "console_scripts": [
            "hapticmech = hapticmech_ros.__main__:main",
            *(f"{name} = hapticmech_ros.nodes.entry:{name}" for name in EXECUTABLES),
        ]
    },
    install_requires=[
        # Looked at when a command or a node starts, by hapticmech_ros/system/installation.py. The
        # lowest versions are those of Ubuntu 24.04 where these will do.
        # Comes with pin as well, which uses it by itself; contacts call it.
        "coal>=3,<4",
        # Unpacks chunks of bags; rosbags needs it as well.
        "lz4>=4",
        "matplotlib>=3.6",
        # Records of mcap files.
        "mcap>=1.2",
        # Puts compiled kernels into memory; numba, which compiles them, needs it as well.
        "llvmlite>=0.44",
        "numba>=0.61",
        "numpy>=1.26",
        # Reads the versions above and below.
        "packaging>=24",
        "pin>=4.1,<5",
        "pydantic>=2.5",
        # Reads YAML, by LibYAML; ruamel.yaml, which rosbags brings, writes it.
        "PyYAML>=6",
        "rich>=13.7",
        # Since then it brings backports.zstd, which unpacks chunks of bags before Python 3.14.
        "rosbags>=0.11.7",
        "ruamel.yaml>=0.17",
        "scipy>=1.11",
        # Numba links the library of kernels with it.
        "setuptools>=68",
        "typer>=0.19",
    ],
    extras_require={
        # Another simulator, which `python -m benchmarks speed` puts beside ours, and what processes
        # take of a machine.
        "bench": [*MJCF, PSUTIL],
        # Processes of a cluster, for `--cluster`, which asks for the same version.
        "cluster": CLUSTER,
        # What the driver of a Haply Inverse3 speaks to its service with, and the emulator.
        "haply": HAPLY,
        # The documentation as a site.
        "docs": DOCS,
        # Reads MJCF files.
        "mjcf": MJCF,
        # The page of `hapticmech live`, which asks for the same version, and its MJCF files.
        "live": LIVE,
        # Tests of what is read from files read these robots, 130 MB of them, where they are.
        "robots": ["example-robot-data>=6"],
        # ROS 2 from PyPI. Never beside a sourced ROS 2 installation, which has all of this.
        "ros": [
            "ros-jazzy-common-interfaces",
            "ros-jazzy-rclpy[fastrtps]",
        ],
        # Nothing here may bring `lark`: it overwrites `lark-parser`, which the wheels need.
        "test": [
            "colcon-common-extensions",
            "import-linter>=2.6",
            "mcap",
            "mcap-ros2-support",
            # The documents are built as a site.
            *DOCS,
            # A study is shared by a cluster on this machine.
            *CLUSTER,
            *HAPLY,
            # The live page is served to a browser.
            *LIVE,
            # Tests check that our motions equal its.
            *MJCF,
            "mypy>=1.10",
            # Benchmarks are run, the shortest forms of them.
            PSUTIL,
            "pytest>=7.4",
            "pytest-cov",
            "pytest-xdist>=3.2",  # worksteal
            "ruff>=0.6",
            # 70.1 builds wheels by itself; 80 dropped what `colcon build --symlink-install` calls.
            "setuptools>=70.1,<80",
        ],
    },
)
