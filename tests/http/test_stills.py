"""Camera stills over HTTP."""

import hashlib

from pa_console.session.stills import stills_folder
from tests.http.conftest import Site
from tests.http.test_served_session import decision, problem
from tests.stills import CAMERA


def test_stills_are_served_as_they_are_kept(site: Site) -> None:
    site.happens({"kind": "spawn", "gate": "NorthGate", "distance_m": 40.0}, 6.0)
    (track,) = site.ask("GET", "/v1/state", "observer").json()["picture"]["tracks"]
    taken = site.ask("GET", f"/v1/tracks/{track}/still", "observer")
    assert taken.status_code == 200, taken.text
    assert taken.headers["content-type"] == "image/png"
    sha256 = hashlib.sha256(taken.content).hexdigest()
    assert taken.headers["etag"] == f'"{sha256}"'
    assert (stills_folder(site.log) / f"{sha256}.png").read_bytes() == taken.content
    assert site.ask("GET", f"/v1/stills/{sha256}", "observer").content == taken.content

    plan = site.waiting(f"Look at {track} at the north gate.")
    (shown,) = site.until("/v1/plans", lambda plans: plans if plans[0]["still"] else None)
    assert (shown["still"]["camera"], shown["still"]["track"]) == (CAMERA, track)
    kept = site.ask("GET", f"/v1/stills/{shown['still']['sha256']}", "observer")
    assert hashlib.sha256(kept.content).hexdigest() == shown["still"]["sha256"]
    assert shown["shown_sha256"] == plan["shown_sha256"], "it is no part of what is decided"
    site.ask("POST", "/v1/decisions", json=decision(shown, "reject"))
    detail = site.ended(plan["mission"]["id"])
    assert detail["stills"]["1"]["sha256"] == shown["still"]["sha256"]


def test_where_there_is_none_the_answer_says_why(site: Site) -> None:
    missing = problem(site.ask("GET", "/v1/tracks/Track_99/still"), 404)
    assert "no track 'Track_99'" in missing["detail"]
    for name in ("0" * 64, "..%2Fsession.jsonl", "x"):
        assert site.ask("GET", f"/v1/stills/{name}").status_code == 404
    assert site.ask("GET", f"/v1/stills/{'0' * 64}", "").status_code == 401
