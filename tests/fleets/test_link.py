"""Links are found by the scheme of their address; what is missing is named with its remedy."""

from importlib.metadata import EntryPoint

import pytest

from pa_console.fleets import link as links
from pa_console.fleets.link import GROUP, open_link
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

OPENED: list[tuple[str, World, Settings]] = []


def open_nothing(address: str, world: World, settings: Settings) -> None:
    OPENED.append((address, world, settings))


def with_scheme(monkeypatch: pytest.MonkeyPatch, *points: EntryPoint) -> None:
    monkeypatch.setattr(links, "link_schemes", lambda: {point.name: point for point in points})


def test_the_entry_point_of_the_scheme_gets_the_rest_of_the_address(
    monkeypatch: pytest.MonkeyPatch, world: World
) -> None:
    with_scheme(monkeypatch, EntryPoint("own", f"{__name__}:open_nothing", GROUP))
    settings = Settings()
    open_link("own:udp://0.0.0.0:14540", world, settings)
    (opened,) = OPENED
    assert opened == ("udp://0.0.0.0:14540", world, settings)


def test_an_unknown_scheme_names_what_there_is(world: World) -> None:
    with pytest.raises(ValueError, match=r"no link 'rso2'.*mqtts://HOST/SITE.*ros2:"):
        open_link("rso2:tcp/10.0.0.4:7447", world, Settings())


def test_a_missing_library_is_named_with_the_extra_that_brings_it(
    monkeypatch: pytest.MonkeyPatch, world: World
) -> None:
    own = EntryPoint("mavlink", "no_such_library.link:open_link", GROUP)
    monkeypatch.setattr(links, "OWN", (own,))
    with_scheme(monkeypatch, own)
    with pytest.raises(ValueError, match=r"no_such_library.*pip install .*\[mavlink\]'"):
        open_link("mavlink:drones.yaml", world, Settings())


def test_a_broken_package_of_somebody_else_is_named(
    monkeypatch: pytest.MonkeyPatch, world: World
) -> None:
    with_scheme(monkeypatch, EntryPoint("own", f"{__name__}:no_such_function", GROUP))
    with pytest.raises(ValueError, match="no_such_function"):
        open_link("own:", world, Settings())
