"""Who may move for a wish, and who is left for it when others move for the other wishes."""

from dataclasses import dataclass

from pa_console.llm.reading import Wish
from pa_console.orchestrator.hindrance import can_have
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.schema.world import AssetKind


def post_of(moves: PlanMoves, wish: Wish) -> str:
    """Return the place that is to be taken over: as said, or that of the asset that leaves."""
    return wish.place or (moves.post(wish.leaving) if wish.leaving else "")


@dataclass(frozen=True)
class Case:
    """A plan, and the wishes of its order that can be carried out."""

    moves: PlanMoves
    due: tuple[Wish, ...]
    others_stay: bool
    watched: frozenset[str] = frozenset()
    """Places of wishes that nobody can carry out: to look there is a safe alternative (CAP-10)."""

    def spare(self, wish: Wish, kind: AssetKind | None = None) -> list[str]:
        """Return who is free, of one kind if that is given, and does nothing but for `wish`.

        Where `wish` says from where they are to come, nobody else.
        """
        moves, others = self.moves, [each for each in self.due if each != wish]
        return [
            name
            for name in moves.free(kind)
            if is_of(moves, name, wish)
            and not moves.takes_over(name)
            and not (name in moves.moved and any(_carries_out(moves, name, w) for w in others))
        ]

    def can_deal(self, wish: Wish) -> bool:
        """Whether somebody could look at the place of `wish`, or deal with whoever is there.

        A drone can, from where it stands or as a spare one; a robot once a track was seen (WF-02).
        """
        moves, tracks = self.moves, self.moves.tracks(wish.place)
        seen = bool(tracks) and all(track.observed for track in tracks)
        kinds: tuple[AssetKind, ...] = ("uav", "robot") if seen else ("uav",)
        if any(moves.there(wish.place, kind) for kind in kinds):
            return True
        return not self.others_stay and any(self.spare(wish, kind) for kind in kinds)


def is_of(moves: PlanMoves, name: str, wish: Wish) -> bool:
    """Whether `name` comes from where those are to come from who are asked for."""
    return wish.team.origin in ("", moves.post(name))


def may(moves: PlanMoves, name: str, wish: Wish) -> bool:
    """Whether `name` may move for `wish`."""
    if name in (*wish.team.names, wish.leaving):
        return True
    goal, fits = moves.ends(name), wish.team.kind in (None, moves.kind(name))
    from_there = is_of(moves, name, wish)
    match wish.task:
        case "go" | "mass":
            return not wish.team.names and goal == wish.place and fits and from_there
        case "home":
            return not wish.team.names and goal == moves.world.base and fits and from_there
        case "look":
            return goal == wish.place and moves.kind(name) == "uav" and from_there
        case "cover" | "relieve":
            return goal == post_of(moves, wish) and from_there
        case "stand_down":
            return goal == moves.world.base and moves.post(name) == wish.place
        case "identify" | "warn" | "block" | "respond":
            return goal == wish.place
        case _:
            return False


def _carries_out(moves: PlanMoves, name: str, wish: Wish) -> bool:
    """Whether `name` moves for what is asked by `wish`, and not only to look first (WF-02)."""
    kind = moves.kind(name)
    asked = name in wish.team.names or wish.team.kind in (None, kind)
    return may(moves, name, wish) and (name == wish.leaving or asked) and can_have(kind, wish.task)
