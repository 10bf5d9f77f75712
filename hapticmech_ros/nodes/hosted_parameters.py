# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's parameters: declared with descriptors, validated as a whole, applied as a whole.

Callbacks of parameters and ticks run in one thread: a change comes between two ticks. Whole numbers
are taken where numbers are wanted; a value that a parameter has already is no change, so that a
node takes its own ``ros2 param dump``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.parameters import (
    LOCK,
    NodeParameters,
    ParameterError,
    changes_of,
    choices_of,
    is_typed,
    locked_by,
    range_of,
    validated,
)

SIM_TIME = "use_sim_time"


class HostedParameters:
    """The parameters of a model, on a node.

    Args:
        node: where they are declared.
        model: what there is, and its rules.
        configured: whether something is built from them, so that some can no longer change.
        checked: called with parameters that keep the model's rules; may refuse by HapticMechError.
        adopted: called with the parameters before, after a change.

    Raises:
        ParameterError: what the node was started with breaks a rule.
    """

    def __init__(
        self,
        node: Node,
        model: type[NodeParameters],
        configured: Callable[[], bool],
        checked: Callable[[NodeParameters], None],
        adopted: Callable[[NodeParameters], None],
    ) -> None:
        self._node = node
        self._model = model
        self._configured = configured
        self._vetted = checked
        self._adopted = adopted
        overrides = node._parameter_overrides
        for name, given in overrides.items():
            overrides[name] = self._as_number(given)
        try:
            self.values = validated(model, {name: self._declare(name) for name in self._names})
        except ParameterError as error:
            raise ParameterError(f"{node.get_name()}: {error}") from None
        self._name_unknown()
        node.add_pre_set_parameters_callback(self._as_numbers)
        node.add_on_set_parameters_callback(self._vet)
        node.add_post_set_parameters_callback(self._adopt)

    @property
    def _names(self) -> list[str]:
        return list(self._model.model_fields)

    def _declare(self, name: str) -> object:
        default = self._model.model_fields[name].default
        try:
            descriptor = descriptor_of(self._model, name)
            return self._node.declare_parameter(name, default, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(str(error)) from None

    def _as_number(self, given: Parameter) -> Parameter:
        """Return a parameter with a whole number as the number that is wanted there."""
        field = self._model.model_fields.get(given.name)
        if field is None or type(field.default) is not float or type(given.value) is not int:
            return given
        return Parameter(given.name, value=float(given.value))

    def _as_numbers(self, changes: list[Parameter]) -> list[Parameter]:
        return [self._as_number(given) for given in changes]

    def _is_new(self, given: Parameter) -> bool:
        """Return whether a parameter would be another than now."""
        if given.name == SIM_TIME:
            return bool(given.value != self._node.get_parameter(SIM_TIME).value)
        known = given.name in self._model.model_fields
        return not known or given.value != getattr(self.values, given.name)

    def _name_unknown(self) -> None:
        """Name what somebody gave and nobody has: most often a slip of the pen."""
        for name in self._node._parameter_overrides:
            if not self._node.has_parameter(name) and not name.startswith("qos_overrides"):
                known = ", ".join(self._names)
                self._node.get_logger().warning(
                    f"unknown parameter {name!r} is ignored; this node has: {known}"
                )

    def _proposed(self, changes: Sequence[Parameter]) -> NodeParameters:
        new = {p.name: p.value for p in changes if p.name in self._model.model_fields}
        return validated(self._model, {**self.values.model_dump(), **new})

    def _vet(self, changes: Sequence[Parameter]) -> SetParametersResult:
        # rclpy takes this for declared.
        if not all(p.name for p in changes):
            return SetParametersResult(successful=False, reason="'': must have a name")
        new = [p.name for p in changes if self._is_new(p)]
        locked = [name for name in new if locked_by(self.values, name)]
        if locked:
            reason = f"{', '.join(locked)}: stays as it is, since the node was started with {LOCK}"
            return SetParametersResult(successful=False, reason=reason)
        given = [name for name in new if self._changes(name) == "never"]
        if given:
            reason = f"{', '.join(given)}: can only be given at the start"
            return SetParametersResult(successful=False, reason=reason)
        fixed = [name for name in new if self._configured() and self._is_fixed(name)]
        if fixed:
            reason = f"{', '.join(fixed)}: can change only while the node is unconfigured"
            return SetParametersResult(successful=False, reason=reason)
        try:
            self._vetted(self._proposed(changes))
        except HapticMechError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _changes(self, name: str) -> str:
        """Return when a parameter may change; nothing: it is rclpy's own."""
        return changes_of(self._model, name) if name in self._model.model_fields else ""

    def _is_fixed(self, name: str) -> bool:
        return name == SIM_TIME or self._changes(name) == "unconfigured"

    def _adopt(self, changes: Sequence[Parameter]) -> None:
        before, self.values = self.values, self._proposed(changes)
        self._adopted(before)


def descriptor_of(model: type[NodeParameters], name: str) -> ParameterDescriptor:
    """Return what `ros2 param describe` shows of a parameter."""
    changes = changes_of(model, name)
    rules = []
    if choices := choices_of(model, name):
        rules.append(f"one of {', '.join(choices)}")
    if changes == "unconfigured":
        rules.append("can change only while the node is unconfigured")
    elif changes == "never":
        # Not as read-only: rclpy refuses to set that to the value which it has.
        rules.append("can only be given at the start")
    bounds = range_of(model, name)
    whole = isinstance(model.model_fields[name].default, int)
    return ParameterDescriptor(
        description=model.model_fields[name].description or "",
        additional_constraints="; ".join(rules),
        dynamic_typing=not is_typed(model, name),
        floating_point_range=[FloatingPointRange(from_value=bounds[0], to_value=bounds[1])]
        if bounds and not whole
        else [],
        integer_range=[IntegerRange(from_value=int(bounds[0]), to_value=int(bounds[1]))]
        if bounds and whole
        else [],
    )
