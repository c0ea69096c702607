"""A model on a server is named by an address without a key; in clear words go to loopback only."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.llm.backend import ModelError, names_backend
from pa_console.llm.models.catalogue import Catalog
from pa_console.llm.remote.address import ServerAddress
from pa_console.llm.remote.servers import Servers, session_models

LOCAL = "openai:http://127.0.0.1:8080/v1#qwen"
ELSEWHERE = "openai:http://10.0.0.5:8000/v1#qwen"


@pytest.mark.parametrize(
    ("text", "base", "name", "private"),
    [
        (LOCAL, "http://127.0.0.1:8080/v1", "qwen", True),
        ("openai:http://localhost:11434#llama3:8b", "http://localhost:11434/v1", "llama3:8b", True),
        ("openai:http://[::1]:1/v1/#a/b", "http://[::1]:1/v1", "a/b", True),
        ("openai:https://models.example/api#m", "https://models.example/api", "m", True),
        (ELSEWHERE, "http://10.0.0.5:8000/v1", "qwen", False),
        ("openai:http://127.0.0.1.example/v1#m", "http://127.0.0.1.example/v1", "m", False),
    ],
)
def test_an_address_says_where_and_which(text: str, base: str, name: str, private: bool) -> None:
    address = ServerAddress.parse(text)
    assert (address.base_url, address.name, address.private) == (base, name, private)
    assert ServerAddress.parse(str(address)) == address


@pytest.mark.parametrize(
    "text",
    [
        "openai:",
        "openai:http://127.0.0.1:8080/v1",
        "openai:ftp://127.0.0.1/v1#m",
        "openai:http://127.0.0.1:99999/v1#m",
        "openai:http://[::1/v1#m",
        "http://127.0.0.1/v1#m",
    ],
)
def test_what_is_no_address_is_refused_with_the_form(text: str) -> None:
    with pytest.raises(ModelError, match="openai:BASE_URL#NAME"):
        ServerAddress.parse(text)


@given(st.text(alphabet="abc123-_", min_size=4).map(lambda text: f"sk{text}"))
def test_a_key_in_an_address_is_refused_and_not_repeated(secret: str) -> None:
    for where in (f"http://user:{secret}@host/v1#m", f"http://host/v1?api_key={secret}#m"):
        with pytest.raises(ModelError) as refused:
            ServerAddress.parse(f"openai:{where}")
        assert secret not in str(refused.value)


@given(st.text())
def test_any_text_is_an_address_or_a_model_error(text: str) -> None:
    try:
        address = ServerAddress.parse(f"openai:{text}")
    except ModelError:
        return
    assert names_backend(str(address))


def test_words_go_to_another_machine_in_clear_only_where_that_is_allowed() -> None:
    with pytest.raises(ModelError, match="plain_servers"):
        Servers.open({"planner": ELSEWHERE})
    assert Servers.open({"planner": ELSEWHERE}, plain=True).named == {"planner": ELSEWHERE}
    assert Servers.open({"planner": LOCAL}).named == {"planner": LOCAL}


def test_planner_and_judge_share_an_engine_at_one_address_only() -> None:
    other = LOCAL.replace("8080", "8081")
    both = Servers.open({"planner": LOCAL, "judge": LOCAL})
    apart = Servers.open({"planner": LOCAL, "judge": other})
    assert list(both.backends.values()) == [("planner", "judge")]
    assert list(apart.backends.values()) == [("planner",), ("judge",)]


def test_the_own_model_is_the_default_where_the_named_one_is_on_a_server() -> None:
    chosen = session_models(LOCAL, "", "pa-500m")
    assert (chosen.own, chosen.second_reader) == (None, "pa-500m")
    assert chosen.named == {"planner": LOCAL}
    assert session_models("pa-500m", "", "").named == {}
    with pytest.raises(ModelError, match="judge_server"):
        session_models(None, "pa-500m", "")


def test_no_server_is_in_the_catalogue_as_shipped() -> None:
    assert Catalog.load().servers == ()


def test_a_model_on_a_server_is_none_of_this_machine() -> None:
    with pytest.raises(ModelError, match="on a server"):
        Catalog.load().get(LOCAL)
