"""A period of rendering in one kernel: controllers, what is on the way, and the device's side."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, put
from hapticmech_ros.control.account_kernels import (
    ANSWERED,
    FORCE_GAIN,
    GIVEN_THEN,
    IS_ANSWER,
    MODELLED,
    PERIOD,
    WRENCHES,
    account_for_hand,
    account_for_motion,
    conclude,
    give_answer,
    passive_wrench,
    queue_wrench,
)
from hapticmech_ros.control.device_side_kernels import (
    QUEUE_AT,
    account_for_actuators,
    correct,
    enforce,
    take_energy,
)
from hapticmech_ros.device.safety_kernels import stay_within
from hapticmech_ros.layout import OPERATIONAL_MODEL

TWIST = OPERATIONAL_MODEL.start("twist")


@inner
def queue_answer(account: Array, queue: Array, arrived: Array) -> int:
    """Put an answer into the queue (delay + 1, ...); return the row of the one that acts now."""
    delay = queue.shape[0] - 1
    at = int(account[QUEUE_AT])
    # The row after the one that is filled is the oldest.
    put(queue[at], arrived)
    account[QUEUE_AT] = (at + 1) % (delay + 1)
    return int((at + 1) % (delay + 1))


@inner
def render(
    controller: Array,
    settings: Array,
    faded: Array,
    told: Array,
    device: Array,
    safety: Array,
    answers: Array,
    sample: Array,
    rendered: Array,
    time: float,
    locality: Array,
    applied: Array,
    added: Array,
    wrenches: Array,
) -> None:
    """Do a period of the loop; see :func:`render_period`."""
    last = answers[answers.shape[0] - 1]
    account_for_motion(controller, rendered[TWIST : TWIST + 6], controller[PERIOD])
    account_for_hand(controller, sample)
    give_answer(controller, settings, faded, told, sample, rendered, time, 0.0, locality, last)
    conclude(controller, settings, sample, rendered, time, locality, last)
    act(controller, last, told, device, safety, answers, sample, applied, added, wrenches)


@inner
def act(
    controller: Array,
    given: Array,
    told: Array,
    device: Array,
    safety: Array,
    answers: Array,
    sample: Array,
    applied: Array,
    added: Array,
    wrenches: Array,
) -> None:
    """Fill what acts on both sides from now on, (3, 6); see :func:`render_period`."""
    rows = answers.shape[0] - 1
    passive_wrench(controller, given, wrenches[2])
    queue_wrench(controller, told, wrenches[2], wrenches[1])
    now = answers[queue_answer(device, answers[:rows], answers[rows])]
    account_for_actuators(device, sample, applied)
    if now[IS_ANSWER] == 0.0:
        wrenches[0] = 0.0
        stay_within(safety, wrenches[0], sample[:3])
        return
    take_energy(device, now[GIVEN_THEN])
    command = now[WRENCHES : WRENCHES + 6]
    if now[MODELLED] == 0.0:
        put(wrenches[0], command)
    else:
        model, answered = now[FORCE_GAIN:ANSWERED], now[ANSWERED:GIVEN_THEN]
        correct(command, model, answered, sample, wrenches[0])
    enforce(device, wrenches[0], sample, added)
    stay_within(safety, wrenches[0], sample[:3])


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[:,::1], float64[::1], float64[::1],"
    " float64[:,::1], float64[::1], float64[::1], float64, float64[::1], float64[::1],"
    " float64[::1], float64[:,::1])"
)
def render_period(
    controller: Array,
    settings: Array,
    faded: Array,
    told: Array,
    device: Array,
    safety: Array,
    answers: Array,
    sample: Array,
    rendered: Array,
    time: float,
    locality: Array,
    applied: Array,
    added: Array,
    wrenches: Array,
) -> None:
    """Answer a sample, and fill what acts on device and mechanism over the next period.

    Controllers and device in one process, without a channel between them.

    Args:
        controller: the controller's account.
        settings: (58,) of the controllers, see :mod:`~hapticmech_ros.control.kernels`.
        faded: (6,) what is carried on from another grasp, as far as it has not faded.
        told: (delay, 6) what the mechanism was told and does not act yet.
        device: the device's account.
        safety: its envelope, a :data:`~hapticmech_ros.device.safety_layout.SAFETY`.
        answers: (delay + 2, ...) answers that do not act yet, the row after them, and the last one.
        sample: (19,) of the device.
        rendered: (139,) operational model.
        time: s.
        locality: (3,) see ``answer_sample``.
        applied: (6,) by the actuators until now.
        added: (6,) by the device's driver, to the next command.
        wrenches: (3, 6) to fill: on the hand by the device, on the mechanism by the hand, and what
            the mechanism is told.
    """
    render(
        controller,
        settings,
        faded,
        told,
        device,
        safety,
        answers,
        sample,
        rendered,
        time,
        locality,
        applied,
        added,
        wrenches,
    )


@kernel(
    "void(float64[::1], float64[::1], float64[:,::1], float64[::1], float64[::1], float64[:,::1],"
    " float64[::1], float64[::1], float64[::1], float64[:,::1])"
)
def act_on_answers(
    controller: Array,
    given: Array,
    told: Array,
    device: Array,
    safety: Array,
    answers: Array,
    sample: Array,
    applied: Array,
    added: Array,
    wrenches: Array,
) -> None:
    """Fill what acts over the next period; as :func:`render_period`.

    ``given`` is the last answer that was given, the last row of ``answers`` the last that arrived.
    """
    act(controller, given, told, device, safety, answers, sample, applied, added, wrenches)
