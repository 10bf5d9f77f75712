"""When a device must not obey: an emergency stop, and a second publisher, but not a successor."""

from hapticmech_ros.nodes.command_guard import SECOND, STOPPED, CommandGuard

MS = 1_000_000
TIMEOUT = 12 * MS


class Stage:
    """A guard, and how many publishers the middleware knows."""

    def __init__(self):
        self.publishers = 1
        self.guard = CommandGuard(lambda: self.publishers)
        self.guard.matched(1, 0, TIMEOUT)

    def joined(self, count, now_ms):
        self.publishers = count
        self.guard.matched(count, now_ms * MS, TIMEOUT)

    def heard(self, now_ms, command=b"a", stamp_ms=None):
        self.guard.heard(command, (now_ms if stamp_ms is None else stamp_ms) * MS, now_ms * MS)


def test_one_publisher_is_obeyed():
    stage = Stage()
    for now in range(100):
        stage.heard(now, bytes([now]))
    # A sample answered twice by one publisher is a correction, not another mind.
    stage.heard(100, b"x")
    stage.heard(101, b"y", stamp_ms=100)
    assert stage.guard.fault == ""


def test_a_publisher_that_joins_a_speaking_one_is_one_too_many_until_it_leaves():
    stage = Stage()
    stage.heard(100)
    stage.joined(2, 105)
    assert stage.guard.fault == SECOND
    stage.heard(110)
    assert stage.guard.fault == SECOND
    stage.joined(1, 120)
    assert stage.guard.fault == ""


def test_who_takes_over_from_a_silent_or_dead_one_is_obeyed():
    stage = Stage()
    stage.heard(100)
    stage.joined(2, 113)
    for now in range(113, 200):
        stage.heard(now, bytes([now]))
    assert stage.guard.fault == ""


def test_two_answers_to_one_sample_are_told_apart():
    stage = Stage()
    stage.joined(2, 100)
    stage.heard(200, b"a")
    stage.heard(201, b"a", stamp_ms=200)
    assert stage.guard.fault == ""
    stage.heard(202, b"b", stamp_ms=200)
    assert stage.guard.fault == SECOND


def test_a_fault_is_forgotten_after_a_second_of_silence():
    stage = Stage()
    stage.heard(100)
    stage.joined(2, 101)
    stage.heard(1100)
    assert stage.guard.fault == SECOND
    stage.heard(2101)
    assert stage.guard.fault == ""


def test_an_emergency_stop_lasts_and_comes_first():
    stage = Stage()
    stage.guard.stop(True)
    stage.heard(1)
    stage.joined(2, 2)
    assert stage.guard.fault == STOPPED
    stage.guard.stop(False)
    assert stage.guard.fault == SECOND
    stage.joined(1, 3)
    assert stage.guard.fault == ""
