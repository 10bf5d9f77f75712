# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers of Fig. 3 as a node: answers every device measurement with two wrenches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.control import Clutch, ControlArchitecture
from hapticmech_ros.control.account_kernels import lateness
from hapticmech_ros.control.loop_layout import Answer, ControllerSettings, Locality
from hapticmech_ros.control.other_hands import coupling_gain, received_directly
from hapticmech_ros.control.rendering_controller import (
    ControllerCommand,
    ControllerInput,
    RenderingController,
)
from hapticmech_ros.control.tuning import tuned
from hapticmech_ros.device.safety import MotionCheck
from hapticmech_ros.device.state import NO_WRENCH
from hapticmech_ros.mechanism.closures import GRASP_SIZE
from hapticmech_ros.nodes import control_kernels as own
from hapticmech_ros.nodes.actor import Actor, Host
from hapticmech_ros.nodes.buttons import ButtonInput
from hapticmech_ros.nodes.controller_ports import (
    PERIOD_S,
    ControllerOutputs,
    CrtkDevice,
    DevicePath,
    EngagementLog,
)
from hapticmech_ros.nodes.inputs import NEVER, Latest
from hapticmech_ros.nodes.messages import check_age
from hapticmech_ros.nodes.other_users import Transmissions
from hapticmech_ros.nodes.parameters import ControllerParameters
from hapticmech_ros.nodes.plain_messages import (
    PlainCommand,
    PlainMessages,
    Publication,
    Received,
)
from hapticmech_ros.nodes.sources import Origin, Sources, first_fault
from hapticmech_ros.nodes.timeouts import (
    CONTROLLER_INPUT,
    Losses,
    SenderPauses,
    plain_timeout_ns,
    timeout_of,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import ControllerEnergies, OperationalModelSample
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.plan.loop_check import loop_warning
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.wire.bounds import message_bounds, read
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import reading_bounds
from hapticmech_ros.wire.messages import (
    DeviceStateMessage,
    LocalFeedbackGain,
    OperationalModelMessage,
)
from hapticmech_ros.wire.topics import DEVICE_POSE, DEVICE_STATE, POINT_COMMAND, POINT_MODEL

CLUTCHED = "the button of the clutch is pressed"
DISOBEYED = ", which the mechanism does not obey"
# Zeros are stamped this much after the last answers, ns, which follow their samples by up to 1 us.
ZERO_AFTER_NS = 2000


class SampleAnswers(PlainMessages):
    """Answers a controller's device samples by a compiled kernel.

    Args:
        actor: the controller.
        device: publishers of the samples.
        analyser: publishers of the operational models.
        outputs: the controller's topics.
        crtk: CRTK topics with the same data as the samples, and the publishers of each.
    """

    def __init__(
        self,
        actor: TeleoperationController,
        device: Sources,
        analyser: Sources,
        outputs: ControllerOutputs,
        crtk: Sequence[tuple[str, Sources]],
    ) -> None:
        received = []
        for name, fields, bounds, sources in (
            (DEVICE_STATE.name, DeviceStateMessage.layout, actor.bounds.device, device),
            (
                POINT_MODEL.of(actor.point),
                OperationalModelMessage.layout,
                actor.bounds.model,
                analyser,
            ),
        ):
            prefix, topic = FlatArray(fields).prefix, actor.lane_topic(name, Float64MultiArray)
            awaited = sources is device
            received.append(Received(topic, sources, prefix, bounds.most, awaited=awaited))
        command, gain = PlainCommand(actor.wrenches), FlatArray(LocalFeedbackGain.layout)
        gain_most = message_bounds(LocalFeedbackGain, actor.limits).most
        published = [
            Publication(outputs.to_device, command.prefix, command.most),
            Publication(outputs.to_point, command.prefix, command.most),
            Publication(outputs.to_gain, gain.prefix, gain_most),
        ]
        self.link = own.ControllerLink()
        super().__init__(actor, received, published, self.link, crtk)
        self._controller, self._topics = actor, outputs
        self._known, self._grasp = OperationalModelSample(), np.zeros(GRASP_SIZE)
        self._answer, self._round_trips = Answer(), np.zeros(2)
        self._settings, self._locality = ControllerSettings(), Locality()
        self.link.period = nanoseconds(actor.period_s)

    def ready(self) -> bool:
        """Set the kernel's inputs from the controller; return whether the kernel may run."""
        found = self._controller.plainly(self.link, self._known.values, self._grasp)
        if found is None:
            return False
        self._settings, self._locality = found
        self._round_trips[:] = self._controller.path.round_trips
        self.link.sample_ns = 0
        if not self.outputs[own.AS_GAIN].sending.hearers:
            self.link.gain_every = 0
        return True

    def kernel(self) -> Callable[[], int]:
        """Return the kernel with its arguments bound."""
        actor, side = self._controller, self._controller.side
        self._answer = Answer()
        states, models = self.inputs
        to_device, to_point, as_gain = self.outputs
        return partial(
            own.answer_samples,
            self.link,
            states,
            models,
            self.passed,
            to_device,
            to_point,
            as_gain,
            self.polled,
            self._known,
            self._grasp,
            side.account,
            self._settings,
            NO_WRENCH,
            side.queue,
            side.past,
            self._locality,
            self._answer,
            actor.motion.numbers,
            self._round_trips,
            self.ages,
        )

    def did(self, code: int, reads: int) -> None:
        """Update the controller with the results of the kernel's run."""
        states, models = self.inputs
        if read := models.reading.read:
            origin = self.origin(own.MODELS)
            self._controller.received_model(self.link, self._known.values, origin, read)
        if states.reading.read:
            self._controller.path.round_trip = float(self._round_trips[0])
            self._controller.answered(self.link, self._answer, self.origin(own.STATES))

    def view(self) -> Callable[[], None]:
        """Return a function that publishes the views of the last answer."""
        account, stamp_ns = self._controller.side.account, self.link.sample_ns
        answer = ControllerCommand(Answer(self._answer.values.copy()), stamp_ns)
        energies = ControllerEnergies(account.energies.values.copy())
        return partial(self._topics.publish_view, answer.wrenches, stamp_ns, energies)


class TeleoperationController(Actor[ControllerParameters]):
    """Runs a scene's :class:`ControlArchitecture` on every sample of the device.

    It is disengaged while an input is missing or stale, or the mechanism does not receive its
    commands: device and mechanism then receive zero once, and the device no further command. It
    engages again without a jump of the wrench. When the grasp moves to another place it continues
    there, also without a jump. In lockstep it answers once a sample and the operational model of
    the same time have arrived.

    Attributes:
        bounds: of received numbers.
        path: the connection to the device.
        side: the rendering controller.
        motion: checks whether samples are possible motions of the device.
        engagements, grasps: how often it engaged, and how often the grasp moved while engaged.
        loop_warning: a warning about the gains; empty if there is none.
    """

    name = "teleoperation_controller"
    parameters_type = ControllerParameters
    longest_wait_ns = 5_000_000

    def __init__(self, node: Host, parameters: ControllerParameters) -> None:
        super().__init__(node, parameters)
        self._clutch: Clutch | None = None
        self._epoch_ns = 0
        self._control = ControlArchitecture(self.scene)
        self.path = DevicePath(self.scene, node.get_logger().warning)
        self.apply_parameters(parameters)
        self.bounds = reading_bounds(self.limits)
        self._grasp = b""
        self.side = self._new_side()
        self._arrived: ControllerCommand | None = None
        self._rendered_ns = NEVER
        # Whether the device corrects commands; one that uses CRTK only does not.
        self._local = False
        self.engagements = self.grasps = 0
        self._last_fault = ""
        self._last_ns = NEVER
        self._state_ns = NEVER
        # Stamps of the last commands to device and mechanism, ns of their clocks.
        self._command_stamps = 0, 0
        self._model: Latest[OperationalModelMessage] = Latest()
        self._outputs = ControllerOutputs(self, lambda: self._crtk.rotation)
        # In lockstep, by stamp, ns.
        self._devices: dict[int, Array] = {}
        self._models: dict[int, OperationalModelMessage] = {}
        self.loop_warning = loop_warning(self.scene, self.point, self._tuned)
        if self.loop_warning:
            node.get_logger().warning(self.loop_warning)
        self._single: list[Sources] = []
        period_ns, warn = nanoseconds(self.period_s), node.get_logger().warning
        self._losses = Losses(node.pauses, 1.0 / self.period_s, warn)
        self._device_pauses = SenderPauses("the device", period_ns)
        self._model_pauses = SenderPauses("the analyser or the mechanism", period_ns)
        self.motion = MotionCheck(self.scene.device, self.period_s)
        self._crtk = CrtkDevice(
            self,
            self.bounds.twist,
            lambda: self.timeout_ns,
            self.watch,
            self._wants_crtk,
            self._on_crtk,
            self._disengage_for,
            lambda: NO_WRENCH if self._clutch is None else self._carried,
        )
        self.input_array(
            DEVICE_STATE.name,
            self.control_input,
            self._on_device_state,
            DeviceStateMessage.layout,
            device := self.watch(DEVICE_STATE.name),
        )
        model = POINT_MODEL.of(self.point)
        self.input_array(
            model,
            self.control_input,
            self._on_operational_model,
            OperationalModelMessage.layout,
            analyser := self.watch(model),
        )
        self._of_device, self._of_analyser = device, analyser
        # C3 of the hands whose wrenches the device receives directly, and how they move the point.
        self._direct = received_directly(self.shared_scene, self.point, self.other_points)
        self._transmissions = Transmissions(self, self._answer_pair)
        self._crtk.listen()
        self._buttons = ButtonInput(self)
        self._plain = SampleAnswers(self, device, analyser, self._outputs, self._crtk.streams)
        self._log = EngagementLog(node.get_logger, self.now_ns)
        node.every(PERIOD_S, self._log.report_counts, self._log.has_counts)

    @property
    def _tuned(self) -> Controller:
        """The gains set by parameters, before any change for the connection to the device."""
        return tuned(self.scene.controller, self.parameters.gains)

    def apply_parameters(self, parameters: ControllerParameters) -> None:
        """Replace the parameters: the timeout applies from now on, gains move to the new ones."""
        super().apply_parameters(parameters)
        self.timeout_ns = self.silence_ns(self._input_timeout(parameters))
        self._tune()

    def _tune(self) -> None:
        """Move the gains to those for the parameters and the connection to the device."""
        time_s = None if self._clutch is None else self._time_s(self.now_ns())
        self.path.tune(self._control, self._tuned, self.parameters.soften, time_s)

    def validate_parameters(self, parameters: ControllerParameters) -> None:
        """Raise for invalid gains, and for a timeout less safe than the scene's."""
        tuned(self.scene.controller, parameters.gains)
        self._input_timeout(parameters)

    def _input_timeout(self, parameters: ControllerParameters) -> float:
        """Return the input timeout (s), before the allowance for a declared network's jitter.

        Its bounds are those of the device's command timeout: a command is as old as its input.
        """
        return timeout_of(
            parameters, "input_timeout", CONTROLLER_INPUT, self.period_s, self.scene.device
        )

    def watch(self, topic: str) -> Sources:
        """Return a check that a topic has one publisher only; a second one is a fault."""
        self._single.append(self.sources(topic))
        return self._single[-1]

    def _fault(self, now_ns: int) -> str:
        """Return the fault for which nothing may be rendered; empty if there is none."""
        return first_fault(self._single, now_ns) or self.motion.fault

    def _time_s(self, now_ns: int) -> float:
        return (now_ns - self._epoch_ns) / NANOSECONDS

    def _new_side(self, before: RenderingController | None = None) -> RenderingController:
        return RenderingController(
            self._control, self.period_s, self.scene.connection, before=before
        )

    def activate(self) -> None:
        """Wait for device and mechanism; times count from now, to keep their resolution."""
        self._last_ns = self._state_ns = NEVER
        self._model = Latest()
        self._transmissions.activate()
        self._crtk.forget()
        self._epoch_ns = self.now_ns()
        for sources in self._single:
            sources.forget()
        self.path.restart()
        self.motion.restart()
        self.wait_by(self._plain)

    def deactivate(self) -> None:
        """Disengage from device and mechanism."""
        self.wait_by(None)
        self._disengage("deactivated", self._log.stopped)

    def reset(self) -> None:
        """Disengage, send zero to both sides, and restart with new controllers and accounts."""
        self._clutch = self._arrived = None
        self._control = ControlArchitecture(self.scene)
        self.apply_parameters(self.parameters)
        self.side = self._new_side()
        self._devices, self._models = {}, {}
        self._transmissions.reset()
        self.activate()
        now = self.now_ns()
        self._outputs.zero(now, now)

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether the controller is engaged without faults, a sentence, and figures."""
        now = self.now_ns()
        fault = self._fault(now)
        silent = self._lacks_of_device(now) if now - self._last_ns > self.timeout_ns else []
        if not self._model.fresh(now, self.timeout_ns):
            silent.append(POINT_MODEL.of(self.point))
        model = self._model.value
        if not silent and model is not None and not model.commanded:
            silent.append(f"the mechanism to obey {POINT_COMMAND.of(self.point)}")
        engaged = self._clutch is not None and not silent and not fault
        lacks = f"waiting for {', '.join(silent) or 'a device'}"
        sentence = "engaged" if engaged else f"disengaged: {fault}" if fault else lacks
        if not fault and self._buttons.is_pressed(self.parameters.clutch_button):
            sentence = f"disengaged: {CLUTCHED}"
        doubtful = self._transmissions.fault(now)
        if engaged and doubtful:
            sentence += f", publishes no coupling gain: {doubtful}"
        figures = {
            "answers": str(self._outputs.answers),
            "engagements": str(self.engagements),
            **self._losses.figures(),
            "lost_while_sender_paused": str(self._losses.sender_paused),
            "grasps": str(self.grasps),
            "fault": fault,
            "motion_faults": str(self.motion.faults),
            **({"coupling_fault": doubtful} if self.other_points else {}),
            **self.path.figures(self._tuned, self.parameters.soften, self.loop_warning),
            "lost_on_connection": str(self.side.lost),
        }
        return engaged and not doubtful, sentence, figures

    def _lacks_of_device(self, now_ns: int) -> list[str]:
        """Return which of the device's topics are missing: the CRTK topics if it uses those."""
        either = (DEVICE_STATE.name, DEVICE_POSE.name)
        names = " or ".join(self.node.resolve_topic_name(name) for name in either)
        return self._crtk.lacking(now_ns) or [names]

    def _on_device_state(self, values: Array, now_ns: int) -> None:
        inputs = read(DeviceStateMessage, values, self.bounds.device)
        stamp, device = inputs.stamp_ns, inputs.sample.values
        received = self.lockstep or self.path.received(inputs, now_ns, self.age_limit_ns)
        self._state_ns, self._local = now_ns, True
        self._device_pauses.received(stamp, self._of_device.latest, now_ns)
        if self.lockstep:
            self._devices[stamp] = device
            self._answer_pair(stamp)
        elif not received:
            self._last_ns = now_ns  # the device is alive, but a newer sample was answered
        else:
            if self.path.changed(self._time_s(now_ns)):
                self._tune()
            self._answer(device, stamp, now_ns)

    def _answer_pair(self, stamp: int) -> None:
        """Answer in lockstep once all inputs of one time, ns, have arrived."""
        if not (stamp in self._devices and stamp in self._models):
            return
        if not self._transmissions.take(stamp):
            return
        device, model = self._devices.pop(stamp), self._models.pop(stamp)
        self._last_ns = stamp
        self._answer_to(device, model, stamp, stamp)

    def _wants_crtk(self, now_ns: int) -> bool:
        """Return whether to answer CRTK topics: no device state for 1 s, and not in lockstep.

        With two publishers of an input: disengage, and return False.
        """
        if self.lockstep:
            return False
        if rivals := first_fault(self._single, now_ns):
            self._disengage_at(rivals)
            return False
        return now_ns - self._state_ns > NANOSECONDS

    def _on_crtk(self, device: Array, stamp: int, now_ns: int) -> None:
        """Answer a device that uses CRTK only."""
        self._local = False
        self.path.obeyed = True
        if self.path.is_next(stamp, now_ns):
            self._answer(device, stamp, now_ns)

    def _answer(self, device: Array, stamp: int, now_ns: int) -> None:
        self.ages.add(now_ns - stamp)
        gap = now_ns - self._last_ns
        self._last_ns = now_ns
        self.motion.check(device, stamp)
        if fault := self._fault(now_ns):
            self._disengage_at(fault)
            return
        if self.path.paced:
            self.path.put(device, stamp)
            return
        if self._opened():
            return
        model = self._model.value
        if model is None or not self._model.fresh(now_ns, self.timeout_ns):
            silence = now_ns - self._model.stamp_ns
            self._disengage_for([POINT_MODEL.of(self.point)], silence, self._model_pauses)
            return
        if gap > self.timeout_ns:
            self._disengage_for([DEVICE_STATE.name], gap, self._device_pauses)
        if not model.commanded:
            # The mechanism does not receive commands (yet): no commands to the device until then.
            self._disengage_for([POINT_COMMAND.of(self.point) + DISOBEYED])
            self._outputs.mechanism(NO_WRENCH, stamp)
            return
        self._answer_to(device, model, stamp, now_ns)

    def _answer_paced(self, model: OperationalModelMessage, now_ns: int) -> None:
        """Answer the newest sample received over a network, on arrival of an operational model."""
        if fault := self._fault(now_ns):
            self._disengage_at(fault)
            return
        found = self.path.take()
        pause = self.path.turn(now_ns)
        lost = [POINT_MODEL.of(self.point)] if pause > self.timeout_ns else []
        silent = (pause, self._model_pauses) if lost else (now_ns - self._last_ns, None)
        if now_ns - self._last_ns > self.timeout_ns:
            lost.append(DEVICE_STATE.name)
        if not model.commanded:
            lost.append(POINT_COMMAND.of(self.point) + DISOBEYED)
            self._outputs.mechanism(NO_WRENCH, model.stamp_ns)
        if lost:
            self._disengage_for(lost, *silent)
        elif not self._opened() and found is not None:
            self._answer_to(found[0], model, found[1], now_ns)

    def _answer_to(
        self, device: Array, model: OperationalModelMessage, stamp: int, now_ns: int
    ) -> None:
        paced = self.path.paced and not self.lockstep
        # Over a network there is no common time: the newest values are compared.
        apart_ns = 0 if paced else stamp - model.stamp_ns
        ahead = lateness(apart_ns, self.period_s)
        operational_model, clutch = model.operational_model.values, self._clutch
        time_s = self._time_s(now_ns)
        if clutch is None:
            clutch = self._control.engage(time_s, device, operational_model, ahead)
            self.side, self._arrived = self._new_side(self.side), None
            self._rendered_ns = NEVER
            self.engagements += 1
            self._last_fault = ""
            self._log.engaged(self._losses.explained_now(now_ns))
        elif not (self.path.obeyed or self.lockstep):
            # The device does not obey commands: the wrench ramps up once it does.
            clutch = self._control.engage(time_s, device, operational_model, ahead)
        elif model.grasp.tobytes() != self._grasp:
            # The grasp has moved: the hand's wrench is carried over.
            clutch = self._control.engage(time_s, device, operational_model, ahead, self._carried)
            self.side.held_elsewhere()
            self.grasps += 1
        self._grasp = model.grasp.tobytes()
        self._clutch = self._control.with_slip(time_s, clutch, device, operational_model)
        inputs = ControllerInput(
            time_s, stamp, device, operational_model, apart_ns, self._elapsed_ns(model.stamp_ns)
        )
        # Over a network, and until the device obeys, each answer has a local feedback gain.
        often = paced or not self.path.obeyed
        with_model = self._local and (often or self._outputs.wants_gain(stamp))
        answer = self.side.tick(inputs, self._clutch, self._local, with_model)
        if with_model and self.other_points:
            self._outputs.coupling(self._coupled(inputs, self._clutch, now_ns), stamp)
        self._command_stamps = stamp, model.stamp_ns if paced else stamp
        self._send(answer, *self._command_stamps)

    def _coupled(self, inputs: ControllerInput, clutch: Clutch, now_ns: int) -> dict[str, Array]:
        """Return H_j (6, 6) by point; see :mod:`~hapticmech_ros.control.other_hands`."""
        found = self._transmissions.at(inputs.stamp_ns, now_ns)
        if not found or self._control.answers_in_python:
            return {}
        settings = self._control.settings_at(inputs.time, clutch)
        now = settings, inputs.operational_model, inputs.time
        return {
            name: coupling_gain(*now, found[name], share)
            for name, share in self._direct.items()
            if name in found
        }

    def plainly(
        self, link: own.ControllerLink, known: Array, grasp: Array
    ) -> tuple[ControllerSettings, Locality] | None:
        """Return settings and locality if the kernel may answer samples now; else None.

        It may while rendering, if only the inputs change from one sample to the next.

        Args:
            link: to fill: times and counters shared with the kernel.
            known: (139,) to fill: the last operational model received, in SI units.
            grasp: (7,) to fill: the place of the operational point in that model.
        """
        clutch, model, control = self._clutch, self._model.value, self._control
        if clutch is None or clutch.is_closing or model is None or not model.commanded:
            return None
        ours = self._local and self.path.obeyed and self.path.is_settled and not self.path.paced
        simple = self.side.is_ideal and not (control.answers_in_python or control.is_ramping)
        if not (
            ours and simple and self._outputs.are_plain and model.grasp.tobytes() == self._grasp
        ):
            return None
        pressed = self._buttons.is_pressed(self.parameters.clutch_button)
        if self.lockstep or pressed or self._fault(self.now_ns()):
            return None
        link.timeout = plain_timeout_ns(self.timeout_ns)
        link.epoch, link.last = self._epoch_ns, self._last_ns
        link.model_ns, link.rendered = self._model.stamp_ns, self._rendered_ns
        link.newest, link.arrived = self.path.last
        link.gain_from, link.moved = self._outputs.gain_from_ns, self.motion.stamp_ns
        # Python computes coupling gains, with each gain.
        link.gain_every = 0 if self._outputs.couple else self._outputs.gain_every_ns
        for sender, pauses in (
            (link.of_device, self._device_pauses),
            (link.of_analyser, self._model_pauses),
        ):
            _, sender.counted, sender.stamp_ns = pauses.last
            sender.pauses.count = 0
        link.sample_ns = link.answers = 0
        link.until_view = self._outputs.until_view
        known[:] = model.operational_model.values
        grasp[:] = model.grasp
        settings = control.settings_at(self._time_s(self.now_ns()), clutch)
        return ControllerSettings(settings), self.side.locality(True, False)

    def received_model(
        self, link: own.ControllerLink, known: Array, origin: Origin, now_ns: int
    ) -> None:
        """Take over the last operational model that the kernel has received.

        Args:
            link: times and counters shared with the kernel.
            known: (139,) the model, in SI units.
            origin: of the message.
            now_ns: time of arrival, ns.
        """
        stamp_ns = link.model_ns
        before = self._model.value
        if before is not None:
            found = OperationalModelMessage(before.values.copy())
            found.stamp_ns, found.operational_model.values[:] = stamp_ns, known
            self._model.put(found, stamp_ns)
        self._model_pauses.went_on(stamp_ns, origin, now_ns, link.of_analyser.pauses.each())

    def answered(self, link: own.ControllerLink, answer: Answer, origin: Origin) -> None:
        """Take over the kernel's answers.

        Args:
            link: times and counters shared with the kernel.
            answer: the last answer.
            origin: of the last sample.
        """
        stamp_ns, now_ns = link.sample_ns, link.last
        self._last_ns = self._state_ns = now_ns
        self._rendered_ns = link.rendered
        self.path.last = link.newest, link.arrived
        self.motion.stamp_ns = link.moved
        self._device_pauses.went_on(stamp_ns, origin, now_ns, link.of_device.pauses.each())
        self.side.last = ControllerCommand(answer, stamp_ns)
        self._command_stamps = stamp_ns, stamp_ns
        self._outputs.answers += link.answers
        self._outputs.gain_from_ns = link.gain_from

    def _opened(self) -> bool:
        """Disengage while the clutch's button is pressed; return whether it is."""
        pressed = self._buttons.is_pressed(self.parameters.clutch_button)
        if pressed:
            self._disengage(CLUTCHED, self._log.stopped)
        return pressed

    @property
    def _carried(self) -> Array:
        """The wrench (6,) of the last answer to the device; zero if there is none."""
        last = self.side.last
        return NO_WRENCH if last is None else last.wrenches[0]

    def _elapsed_ns(self, stamp_ns: int) -> int:
        """Return the time (ns) from the last rendered model to this one."""
        before, self._rendered_ns = self._rendered_ns, stamp_ns
        return stamp_ns - before if before > 0 else 0

    def _send(self, answer: ControllerCommand | None, stamp_ns: int, mechanism_ns: int) -> None:
        """Send the commands that are due to device and mechanism, then the gain and the view.

        In lockstep the device waits for a command with each sample: the last one is repeated.
        There, over a network and until the device obeys, a gain is sent before its command.
        """
        outputs, side = self._outputs, self.side
        if self.lockstep:
            self._arrived = answer = answer or self._arrived or ControllerCommand.nothing(stamp_ns)
        commanded = side.commanded[0]
        if answer is None:
            outputs.mechanism(commanded, mechanism_ns)
            return
        with_gain = self.lockstep or answer.numbers.modelled != 0.0
        if with_gain and (self.lockstep or self.path.paced or not self.path.obeyed):
            outputs.gain(answer, stamp_ns)
            with_gain = False
        answered_ns = stamp_ns if self.lockstep else answer.answered_ns
        outputs.device(answer.wrenches[0], answered_ns)
        outputs.mechanism(commanded, mechanism_ns)
        if with_gain:
            outputs.gain(answer, stamp_ns)
        outputs.view(answer.wrenches, answered_ns, side.account.energies)

    def _disengage_for(
        self,
        lost: Sequence[str],
        silence_ns: int | None = None,
        sender: SenderPauses | None = None,
    ) -> None:
        """Disengage because inputs are lost, and log what explains it; see :class:`Losses`."""
        now = self.now_ns()

        def log(reason: str) -> None:
            why = self._losses.explained(silence_ns, self.timeout_ns, now, sender)
            self._log.lost(reason, why)

        self._disengage(f"lost {', '.join(lost)}", log)

    def _disengage_at(self, fault: str) -> None:
        """Disengage because of a fault, and log it once, even if disengaged before."""
        if self._clutch is None and fault != self._last_fault:
            self._log.fault(fault)
        self._last_fault = fault
        self._disengage(fault, self._log.fault)

    def _disengage(self, reason: str, log: Callable[[str], None]) -> None:
        """Disengage, and send zero to both sides rather than let them time out."""
        if self._clutch is None:
            return
        self._clutch = None
        device_ns, mechanism_ns = self._command_stamps
        # Later than the last commands, and the stamp of no sample: the device does not correct it.
        self._outputs.zero(device_ns + ZERO_AFTER_NS, mechanism_ns + ZERO_AFTER_NS)
        # Logging takes as long as a period.
        log(reason)

    def _on_operational_model(self, values: Array, now_ns: int) -> None:
        found = read(OperationalModelMessage, values, self.bounds.model)
        check_age(found.stamp_ns, now_ns, self.age_limit_ns)
        self._model.put(found, found.stamp_ns)
        self._model_pauses.received(found.stamp_ns, self._of_analyser.latest, now_ns)
        self.ages.add(now_ns - found.stamp_ns)
        if self.lockstep:
            self._models[found.stamp_ns] = found
            self._answer_pair(found.stamp_ns)
        elif self.path.paced:
            self._answer_paced(found, now_ns)
        elif now_ns - self._last_ns > self.timeout_ns:
            # Without samples no answer is computed: disengage now, which sends zero.
            silence = now_ns - self._last_ns
            self._disengage_for([DEVICE_STATE.name], silence, self._device_pauses)
