"""Whose report an order asks for where it names nobody."""

from pa_console.llm.reading import Wish
from pa_console.schema.telemetry import Picture


def reporters(wish: Wish, picture: Picture) -> tuple[str, ...]:
    """Return the assets that are up and of which a report can be meant, in the picture's order."""
    team = wish.team
    return tuple(
        name
        for name, asset in picture.assets.items()
        if asset.available and team.kind in (None, asset.kind)
        if all(asset.post == at for at in (wish.place, team.origin) if at)
    )


def of_everyone(wish: Wish) -> bool:
    """Whether each of them is asked: of a place, of all of a kind, or of nobody in particular."""
    team = wish.team
    if wish.task != "report" or team.names:
        return False
    return team.number == "all" or bool(wish.place) or not (team.kind or team.origin)
