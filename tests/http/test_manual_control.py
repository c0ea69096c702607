"""Manual control over HTTP: an operator's token takes and gives back, an observer's reads."""

from tests.http.conftest import Site

PATH = "/v1/assets/Drone_T04/manual"


def test_an_asset_is_taken_shown_and_given_back(site: Site) -> None:
    assert site.ask("POST", PATH, "observer").status_code == 403
    assert site.ask("POST", PATH).status_code == 204
    state = site.ask("GET", "/v1/state", "observer").json()
    (taken,) = [one for one in state["manual"] if one["asset"] == "Drone_T04"]
    assert taken["by"]
    assert state["picture"]["assets"]["Drone_T04"]["manual"]
    again = site.ask("POST", PATH)
    assert (again.status_code, again.json()["type"].rpartition(":")[2]) == (409, "not-changed")
    assert site.ask("DELETE", PATH, "observer").status_code == 403
    assert site.ask("DELETE", PATH).status_code == 204
    assert site.ask("GET", "/v1/state", "observer").json()["manual"] == []
    assert site.ask("DELETE", PATH).status_code == 409


def test_an_asset_that_is_not_there_is_not_found(site: Site) -> None:
    refused = site.ask("POST", "/v1/assets/Drone_T99/manual")
    assert refused.status_code == 404
    assert "Drone_T01" in refused.json()["remedy"]
