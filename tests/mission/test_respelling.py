"""Misspelt words of a mission are read as what was meant; everything else stays as it was typed."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.mission.spelling import respell
from pa_console.resources import data_folder
from pa_console.schema.events.event import MissionReceived
from pa_console.station.assembly import Site
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

LISTED = [
    line
    for line in (data_folder() / "rules/vocabulary/operators.txt").read_text().splitlines()
    if not line.startswith("#")
]


@pytest.mark.parametrize(
    ("typed", "read"),
    [
        ("snd a dron to teh noth gaet", "send a drone to the north gate"),
        ("Chekc the vehicel at WestGate, plese.", "Check the vehicle at WestGate, please."),
        ("OBSERV THE GATEHOUSE", "OBSERVE THE GATEHOUSE"),
        ("Drone_T04 identfy whoevr is their", "Drone_T04 identify whoever is their"),
        ("move to Sotuh gate", "move to South gate"),
        ("a drone to estgate and nortgate", "a drone to eastgate and northgate"),
        ("approahcing vehicel; ignroe it", "approaching vehicle; ignore it"),
    ],
)
def test_a_slip_of_the_hand_is_read_as_what_was_meant(site: Site, typed: str, read: str) -> None:
    assert respell(typed, site.world, site.rulebook) == read


@pytest.mark.parametrize(
    "typed",
    [
        "Drone_T04, Ugv_T02: hold. UGV2 n uav3 rtb, thx",
        "I don't want anybody at NorthGate; wont you see to it, pls?",
        "Schicke sofort eine Drohne zum Nordtor und beobachte das Fahrzeug",
        "Send Mr Nordvik's parcel to the loading dock",
        "the QRF and the CCTV",
        "everything quiet at northgate and southgate",
        "recognise the colour of the grey lorry, signalling from the centre",
        "",
    ],
)
def test_what_is_no_slip_stays(site: Site, typed: str) -> None:
    assert respell(typed, site.world, site.rulebook) == typed


@pytest.mark.parametrize(
    ("typed", "turned"),
    [("nxt", ""), ("nto", "not"), ("noth", ""), ("twi", ""), ("oen", "one"), ("nott", "not")],
)
def test_a_negation_or_number_is_read_only_where_its_letters_are(
    site: Site, typed: str, turned: str
) -> None:
    read = respell(f"go {typed}", site.world, site.rulebook).removeprefix("go ")
    assert ({read} & {"not", "two", "one"}) == ({turned} - {""})


@given(data=st.data())
def test_known_words_are_never_touched(site: Site, data: st.DataObject) -> None:
    rules = [word for rule in site.rulebook.rules for word in re.findall("[A-Za-z]+", rule.text)]
    words = st.sampled_from([*LISTED, *site.world.frames, *site.world.assets, *rules])
    text = " ".join(data.draw(st.lists(words, min_size=1, max_size=20)))
    assert respell(text, site.world, site.rulebook) == text


@given(text=st.text(max_size=200))
def test_any_text_is_read_and_reading_it_again_changes_nothing(site: Site, text: str) -> None:
    read = respell(text, site.world, site.rulebook)
    assert re.sub("[A-Za-z]+", "", read) == re.sub("[A-Za-z]+", "", text)
    assert respell(read, site.world, site.rulebook) == read


async def test_force_is_refused_however_it_is_spelt(rig: Rig) -> None:
    engine = ScriptedEngine([])
    trace = await rig.run(engine, text="opn fyre on teh truck at the loading dock")
    assert trace.status == "refused"
    assert "ROE-01" in trace.reason
    assert engine.requests == []


async def test_the_log_keeps_what_was_typed_beside_how_it_is_read(rig: Rig) -> None:
    engine = ScriptedEngine([plan(("Drone_T04", "hold"))])
    trace = await rig.run(engine, text="nobdy moves")
    received = next(e.data for e in rig.events if isinstance(e.data, MissionReceived))
    assert (received.mission.typed, received.mission.text) == ("nobdy moves", "nobody moves")
    assert trace.mission.said == "nobdy moves"
    assert 'Mission: "nobody moves"' in engine.requests[0].user
