"""A camera that publishes on a topic: its image is taken when asked for, whatever is published."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.ros2.link import Ros2Link
from pa_console.fleets.snapshot import MOST_SIDE, SnapshotError
from pa_console.schema.world import World
from tests.fleets.ros2.counterpart import REMEDY, Robots, free_domain, linked
from tests.fleets.test_snapshot import bomb, encoded
from tests.stills import CAMERA

pytest.importorskip("rclpy", reason=REMEDY)
pytest.importorskip("nav2_msgs", reason=REMEDY)
rclpy: Any = import_module("rclpy")
CompressedImage: Any = import_module("sensor_msgs.msg").CompressedImage

pytestmark = pytest.mark.long
TOPIC = "/gate/image_raw/compressed"
AGAIN_S = 0.05


class CameraNode:
    """A camera driver, and the fleet of one robot in the same domain."""

    def __init__(self, fleet: LinkedFleet, domain: int) -> None:
        self.fleet, self._context = fleet, rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("camera", context=self._context)
        self._images = self._node.create_publisher(CompressedImage, TOPIC, 1)

    def publish(self, content: bytes) -> bytes:
        """Publish `content` again and again, until the fleet has its image of it."""
        message = CompressedImage(format="jpeg", data=content)
        with ThreadPoolExecutor(1) as threads:
            image = threads.submit(self.fleet.image_on, TOPIC)
            while True:
                self._images.publish(message)
                try:
                    return image.result(AGAIN_S)
                except TimeoutError:
                    continue

    def close(self) -> None:
        """Leave the domain."""
        self._node.destroy_node()
        self._context.try_shutdown()


def with_topic(world: World) -> World:
    site = world.model_dump()
    site["cameras"][CAMERA]["snapshot"] = f"ros2:{TOPIC}"
    return World.model_validate(site)


@pytest.fixture(scope="module")
def camera(world: World, tmp_path_factory: pytest.TempPathFactory) -> Iterator[CameraNode]:
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    domain, folder = free_domain(), Path(tmp_path_factory.mktemp("robots"))
    robots = Robots({"Ugv_T01": (0.0, 0.0)}, domain)
    with linked(domain, with_topic(world), folder, "robots: {Ugv_T01: {}}\n") as listener:
        node = CameraNode(LinkedFleet(with_topic(world), [listener.link]), domain)
        yield node
        node.close()
    robots.close()
    del os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"]


def test_its_image_is_taken_and_written_anew(camera: CameraNode) -> None:
    image = camera.publish(encoded("JPEG", (1600, 900)) + b"<script>")
    with Image.open(BytesIO(image)) as opened:
        assert (opened.format, opened.size) == ("JPEG", (MOST_SIDE, 450))
    assert b"<script>" not in image


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (bytes(5_000_000), "sends more than 4 MB"),
        (encoded("JPEG")[:300], "sends no readable image"),
        (b"<html>log in</html>", "sends no readable image"),
        (b"", "sends no readable image"),
        (bomb(12_000), "sends (too large a|no) picture"),
    ],
)
def test_what_is_no_picture_is_refused_in_words(
    camera: CameraNode, content: bytes, why: str
) -> None:
    with pytest.raises(SnapshotError, match=why):
        camera.publish(content)
    assert camera.publish(encoded("PNG")).startswith(b"\xff\xd8")


def test_doctor_names_a_camera_that_sends_nothing(camera: CameraNode) -> None:
    (link,) = camera.fleet.links
    assert isinstance(link, Ros2Link)
    (row,) = [row for row in link.examine(0.2) if row.agent == CAMERA]
    assert row.found == f"sends no image on {TOPIC} within 0.2 s"
    assert row.consequence == "no still is shown"
