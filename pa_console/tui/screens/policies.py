"""The policy browser: every rule, how it is enforced, and how a text would retrieve it."""

from collections.abc import Sequence

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.widgets import Footer, Input, OptionList, Select, Static
from textual.widgets.option_list import Option

from pa_console.schema.rule import PRIORITIES, Ordering, Rule, RuleHit
from pa_console.schema.rules_seal import RulesSeal
from pa_console.tui.ports import RetrieverPort, RulebookPort
from pa_console.tui.trace.rows import Row, column, row
from pa_console.tui.vocabulary import NOTE, QUIET, term
from pa_console.tui.widgets.sheet import Sheet

_DOMAINS = (("ROE  rules of engagement", "ROE"), ("WF  workflow", "WF"), ("CAP  capability", "CAP"))
_MODES = (("checked by code", "checked"), ("judged by the LLM only", "judged"))


class PolicyScreen(Screen[None]):
    """Filter on the left, the whole rule on the right; typing scores every rule at once."""

    BINDINGS = [
        Binding("escape,f6", "close", "Back"),
        Binding("slash", "search", "Search"),
    ]

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (100, "-wide")]

    def __init__(self, rulebook: RulebookPort, retriever: RetrieverPort) -> None:
        super().__init__()
        self._rules, self._set, self._seal = rulebook.rules, rulebook.name, rulebook.seal
        self._retriever = retriever
        self._hits: dict[str, RuleHit] = {}
        self._wanted: dict[str, str | None] = dict.fromkeys(
            ("policy-domain", "policy-priority", "policy-mode")
        )

    def compose(self) -> ComposeResult:
        """Yield the search line, the filters, the list and the detail."""
        yield Static("Policies", id="policy-title", markup=False)
        with Horizontal(id="policy-filters"):
            yield Input(
                compact=True, id="policy-search", placeholder="Score the rules against a text"
            )
            yield Select(_DOMAINS, prompt="all domains", compact=True, id="policy-domain")
            yield Select(
                [(name, name) for name in PRIORITIES],
                prompt="all priorities",
                compact=True,
                id="policy-priority",
            )
            yield Select(_MODES, prompt="checked and judged", compact=True, id="policy-mode")
        with Horizontal(id="policy-body"):
            yield OptionList(id="policy-list", markup=False)
            with VerticalScroll(id="policy-detail"):
                yield Sheet(id="policy-sheet")
        yield Footer(show_command_palette=False, compact=True)

    def on_mount(self) -> None:
        """Show all rules, ready to search."""
        self.query_one("#policy-search", Input).cursor_blink = False
        self._list()
        self.query_one("#policy-search").focus()

    @on(Input.Changed, "#policy-search")
    def _search(self, event: Input.Changed) -> None:
        text = event.value.strip()
        hits: Sequence[RuleHit] = self._retriever.score_all(text) if text else ()
        self._hits = {hit.rule_id: hit for hit in hits}
        self._list()

    @on(Input.Submitted, "#policy-search")
    def _to_list(self) -> None:
        self.query_one("#policy-list").focus()

    @on(Select.Changed)
    def _filter(self, event: Select.Changed) -> None:
        value: object = event.value
        self._wanted[event.select.id or ""] = None if value is Select.NULL else str(value)
        self._list()

    def shown(self) -> list[Rule]:
        """Return the rules that pass the filters, best score first while there is a search."""
        rules = [
            rule
            for rule in self._rules
            if self._wanted["policy-domain"] in (None, rule.domain)
            and self._wanted["policy-priority"] in (None, rule.priority)
            and self._wanted["policy-mode"] in (None, "checked" if rule.decidable else "judged")
        ]
        if self._hits:
            rules.sort(key=lambda rule: -self._score(rule))
        return rules

    def _score(self, rule: Rule) -> float:
        hit = self._hits.get(rule.id)
        return hit.score if hit else 0.0

    def _list(self) -> None:
        rules = self.shown()
        listing = self.query_one("#policy-list", OptionList)
        listing.clear_options()
        listing.add_options(Option(self._line(rule), id=rule.id) for rule in rules)
        if rules:
            listing.highlighted = 0
        else:
            self.query_one("#policy-sheet", Sheet).show((row("", "No rule passes the filters."),))
        count = sum(rule.decidable for rule in self._rules)
        self.query_one("#policy-title", Static).update(
            Content.assemble(
                ("Policies  ", "bold $text-primary"),
                f"{self._set} {self._seal.title} ",
                (self._seal.words, standing_style(self._seal)),
                (f"  {len(rules)} of {len(self._rules)}, {count} checked by code", QUIET),
            )
        )

    def _line(self, rule: Rule) -> Content:
        urgency = term("priority", rule.priority)
        mode = term("rule", "checked" if rule.decidable else "judged")
        score = f"{self._score(rule):4.2f} " if self._hits else ""
        return Content.assemble(
            (score, NOTE),
            column(rule.id, 7, "bold"),
            (f"{urgency.glyph} ", urgency.style),
            (f"{mode.glyph} ", mode.style),
            rule.text,
        )

    @on(OptionList.OptionHighlighted)
    def _detail(self, event: OptionList.OptionHighlighted) -> None:
        rule = next((rule for rule in self._rules if rule.id == event.option.id), None)
        if rule is not None:
            rows = tuple(rule_rows(rule, self._hits.get(rule.id)))
            self.query_one("#policy-sheet", Sheet).show(rows)
            self.query_one("#policy-detail", VerticalScroll).scroll_home(animate=False)

    def action_close(self) -> None:
        """Go back to the console."""
        self.dismiss()

    def action_search(self) -> None:
        """Type a text to score."""
        self.query_one("#policy-search").focus()


def standing_style(seal: RulesSeal) -> str:
    """Return how the standing of a rule set is written: louder, the less it is vouched for."""
    styles = {"altered": "bold reverse $text-error", "unknown key": "$text-warning"}
    return styles.get(seal.standing, NOTE if seal.key else QUIET)


def rule_rows(rule: Rule, hit: RuleHit | None) -> list[Row]:
    """Return everything there is to know of one rule."""
    urgency = term("priority", rule.priority)
    mode = term("rule", "checked" if rule.decidable else "judged")
    rows = [
        row(
            "",
            (f"{rule.id}  ", "bold"),
            (f"{urgency.glyph} {urgency.word}  ", urgency.style),
            (f"{mode.glyph} {mode.word}", mode.style),
        ),
        row(""),
        row("", rule.text),
        row(""),
        row(column("enforced", 9, QUIET), _enforcement(rule)),
    ]
    if rule.tags:
        rows.append(row(column("tags", 9, QUIET), ", ".join(rule.tags)))
    if hit is not None:
        parts = "  ".join(f"{name} {value:.3f}" for name, value in hit.components.items())
        rows.append(row(column("score", 9, QUIET), (f"{hit.score:.3f}  ", NOTE), (parts, QUIET)))
    for name, value in (
        ("applies", rule.applies),
        ("check", rule.check),
        ("message", rule.message),
    ):
        if value:
            rows += [row(""), row("", (name, f"bold {NOTE}")), row("  ", value.strip())]
    for order in rule.order:
        rows += [row(""), row("", (_ordering(order), f"bold {NOTE}"))]
        rows += [row("  ", part.strip()) for part in (order.event, order.other)]
        rows.append(row("  ", (order.message, QUIET)))
    if rule.examples:
        rows += [row(""), row("", (f"examples ({len(rule.examples)})", f"bold {NOTE}"))]
    for example in rule.examples:
        sign = {"pass": "✔ must hold", "fail": "✘ must be broken"}.get(
            example.expect, "– must not apply"
        )
        rows.append(row("  ", (f"{sign}: ", QUIET), example.name))
        rows += [row("      ", f"{agent}: {command}") for agent, command in example.plan]
        if example.given:
            rows.append(row("      given ", (str(example.given), QUIET)))
        rows += [row("      then ", (str(change), QUIET)) for change in example.moments]
    return rows


def _ordering(order: Ordering) -> str:
    """Return an ordering's kind, its subjects and its time limit; the two events follow it."""
    limit = f" {order.seconds} s" if isinstance(order.seconds, float) else f" {order.seconds}"
    each = f", each {order.each}" if order.each is not None else ""
    return f"order: {order.kind}{limit if order.seconds is not None else ''}{each}"


def _enforcement(rule: Rule) -> str:
    if not rule.decidable:
        return "no: the LLM judges it, code cannot"
    return "blocks a plan for everyone" if rule.enforced else "a warning to be acknowledged"
