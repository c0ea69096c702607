"""The Zenoh keys of a robot's topics and services in both layouts, and the robots present.

Behind zenoh-bridge-ros2dds a key is the ROS name with the bridge's namespace in front. On rmw_zenoh
it is `DOMAIN/NAME/TYPE/HASH`; types and hashes of services depend on the release, so they are read
from the liveliness tokens `@ros2_lv/...` that every ROS node declares. A service of rmw_zenoh takes
no request without an attachment: sequence number, time, and the id of the client.
"""

import struct
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, Protocol

from pa_console.fleets.ros2.connection import Layout

SERVICES = ("send_goal", "cancel_goal", "get_result")
"""The services of an action."""

_TYPES: Mapping[str, str] = MappingProxyType(
    {
        "tf": "tf2_msgs::msg::dds_::TFMessage_",
        "tf_static": "tf2_msgs::msg::dds_::TFMessage_",
        "odom": "nav_msgs::msg::dds_::Odometry_",
        "amcl_pose": "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
        "battery": "sensor_msgs::msg::dds_::BatteryState_",
        "health": "diagnostic_msgs::msg::dds_::DiagnosticStatus_",
        "manual": "std_msgs::msg::dds_::Bool_",
        "status": "action_msgs::msg::dds_::GoalStatusArray_",
        "feedback": "nav2_msgs::action::dds_::NavigateToPose_FeedbackMessage_",
    }
)
"""The types of subscriptions, as rmw_zenoh writes them."""


class Service(NamedTuple):
    """A service of an action of a robot: `name` is one of SERVICES."""

    namespace: str
    action: str
    name: str


class Keys(Protocol):
    """One layout of keys."""

    layout: Layout
    tokens: str
    """The key expression of the liveliness tokens of action servers."""

    def topic(self, namespace: str, name: str, kind: str) -> str:
        """Return the key expression of a topic; `kind` says of what type it is."""
        ...

    def service(self, service: Service) -> str | None:
        """Return the key of a service, None while it is not known to be there."""
        ...

    def saw(self, token: str, *, there: bool) -> str | None:
        """Take in a token that has come or gone; return the action that takes goals by it."""
        ...

    def attachment(self, number: int, time_ns: int) -> bytes | None:
        """Return what goes with the request `number` at a time (UTC), None for nothing."""
        ...


class BridgeKeys:
    """Robots behind zenoh-bridge-ros2dds, each with its namespace in its own bridge."""

    layout: Layout = "bridge"

    tokens = "@/*/@ros2_lv/AS/*/*"

    def topic(self, namespace: str, name: str, kind: str) -> str:  # noqa: ARG002
        """Return the key of a topic."""
        return f"{namespace}/{name}"

    def service(self, service: Service) -> str | None:
        """Return the key of a service; without a robot behind it, nobody answers."""
        return f"{service.namespace}/{service.action}/_action/{service.name}"

    def saw(self, token: str, *, there: bool) -> str | None:  # noqa: ARG002
        """Return the action whose server has come or gone."""
        return token.split("/")[4].replace("§", "/")

    def attachment(self, number: int, time_ns: int) -> bytes | None:  # noqa: ARG002
        """Return None: the bridge numbers requests itself."""
        return None


class RmwKeys:
    """Robots whose ROS 2 runs on rmw_zenoh."""

    layout: Layout = "rmw"

    def __init__(self, domain: int, client: bytes) -> None:
        """`client` is the id of this client, 16 bytes."""
        self._domain, self._client = domain, client
        self.tokens = f"@ros2_lv/{domain}/*/*/*/SS/*/*/*/$*%_action%$*/*/*/**"
        self._there: dict[str, dict[str, str]] = {}
        """Name of a service -> its keys, by token: while a robot starts again it may have two."""

    def topic(self, namespace: str, name: str, kind: str) -> str:
        """Return the key expression of a topic, whatever release its type is of."""
        return f"{self._domain}/{namespace}/{name}/{_TYPES[kind]}/*"

    def service(self, service: Service) -> str | None:
        """Return the key of a service, None until its token has come."""
        name = f"{service.namespace}/{service.action}/_action/{service.name}"
        return next(reversed(self._there.get(name, {}).values()), None)

    def saw(self, token: str, *, there: bool) -> str | None:
        """Take in the token of a service; return the action of one that takes goals."""
        parts = token.split("/")
        name, type_name, type_hash = (part.replace("%", "/") for part in parts[9:12])
        name = name.strip("/")
        keys = self._there.setdefault(name, {})
        if there:
            keys[token] = f"{self._domain}/{name}/{type_name}/{type_hash}"
        else:
            keys.pop(token, None)
        end = "/_action/send_goal"
        return name.removesuffix(end) if name.endswith(end) else None

    def attachment(self, number: int, time_ns: int) -> bytes | None:
        """Return two numbers of 8 bytes, and the length and bytes of the client's id."""
        return struct.pack("<qqB", number, time_ns, len(self._client)) + self._client
