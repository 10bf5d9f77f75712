"""Closures that people open and close while the mechanism runs, one service each."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from std_srvs.srv import SetBool

from hapticmech_ros.errors import ClosureError, InvalidInputError
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.wire.topics import CLOSURES


def offer_closures(node: Host, names: Iterable[str], switch: Callable[[str, bool], None]) -> None:
    """Offer ``mechanism/closures/<name>``: true closes it, false opens it.

    Args:
        node: whose services they are.
        names: of the closures and couplings.
        switch: does it, or raises InvalidInputError or ClosureError, which is answered.
    """
    for name in names:
        answer = partial(_answer, name, switch)
        node.keep(node.create_service(SetBool, f"{CLOSURES.name}/{name}", answer))


def _answer(
    name: str,
    switch: Callable[[str, bool], None],
    request: SetBool.Request,
    response: SetBool.Response,
) -> SetBool.Response:
    try:
        switch(name, bool(request.data))
    except (InvalidInputError, ClosureError) as error:
        response.success, response.message = False, str(error)
    else:
        response.success = True
        response.message = f"{name} is {'closed' if request.data else 'open'}"
    return response
