"""Closed lists of the words that questions to the console are made of."""

OPENING = (
    *("and", "but", "so", "well", "ok", "okay", "hey", "hm", "hmm", "sorry", "please", "just"),
    *("tell me", "can you tell me", "could you tell me", "can you explain", "could you explain"),
    *("can you say", "may i ask", "i wonder", "i want to know", "i would like to know", ","),
)
"""The words before a question that change nothing."""
CLOSING = frozenset(
    ("?", ".", "!", ",", "please", "then", "though", "now", "exactly", "anyway", "again", "at all")
)
WHY = (
    *("explain to me why", "explain me why", "explain why", "explain", "why exactly", "why"),
    *("how come", "how so", "for what reason", "for which reason", "what for", "on what grounds"),
    *("what is the reason for", "what was the reason for", "what 's the reason for"),
    *("what is the reason", "what was the reason", "what 's the reason", "what speaks for"),
)
AGAINST = ("what speaks against", "what stands against", "what is wrong with", "what 's wrong with")
"""The words that ask for all reasons against an asset."""
THAT = (
    *("that plan", "this plan", "the plan", "your plan", "that decision", "this decision"),
    *("the decision", "your decision", "that proposal", "this proposal", "the proposal"),
    *("your proposal", "the verdict", "that verdict", "yourself", "that", "this", "it", "so"),
)
"""The words for the whole plan, proposed or executed."""
AUXILIARIES = frozenset(
    (
        *(
            "did",
            "do",
            "does",
            "is",
            "'s",
            "was",
            "are",
            "'re",
            "were",
            "has",
            "have",
            "'ve",
            "had",
        ),
        *("can", "ca", "could", "would", "will", "wo", "may", "should", "must"),
    )
)
SPEAKERS = ("you", "we", "they", "the console", "the planner", "the model", "i")
"""The planner, in the operator's words."""
PLAN_SUBJECTS = (
    *("you", "we", "i", "it", "that", "this", "they", "nobody", "nothing", "no one", "everybody"),
    *("the plan", "this plan", "that plan", "the order", "my order", "the mission", "the judge"),
    *("the console", "the planner", "the model", "the command", "there", "this mission"),
)
NOTHING_ELSE = ("not", "still", "just", "only", "even", "always", "suddenly", "so")
"""The words that may precede the verb of a question about a plan."""
DONE_TO_PLAN = (
    *("say so", "say that", "say no", "do that", "do this", "do it", "do so", "plan that"),
    *("plan this", "plan it", "decide that", "decide so", "choose that", "choose this"),
    *("propose that", "propose this", "suggest that", "suggest this", "want that", "want this"),
    *(
        "want to do that",
        "want to do this",
        "doing that",
        "doing this",
        "planning that",
        "going on",
    ),
    *("proposing that", "proposing this", "suggesting that", "suggesting this", "asking me that"),
    *("ask me that", "ask me", "ask that", "ask back", "ask", "asking me", "asking", "asked"),
    *("approve it", "approve that", "approve this", "approve the plan", "approve this plan"),
    *("approve that plan", "approve", "approved", "stop", "stopped", "stopping", "refuse it"),
    *(
        "refuse that",
        "refuse this",
        "refuse my order",
        "refuse",
        "refused",
        "refusing",
        "reject it",
    ),
    *("reject that", "reject this", "reject", "rejected", "rejecting", "blocked", "blocking it"),
    *("block it", "held", "holding", "halted", "halt", "cancelled", "canceled", "cancel it"),
    *("cancel that", "fail", "failed", "failing", "verified", "unverified", "happen", "happened"),
    *("happening", "possible", "impossible", "allowed", "forbidden", "not allowed", "object"),
    *("objecting", "object to it", "object to that", "against it", "against that", "narrowed"),
    *("unsure", "sure", "in doubt", "waiting", "wait", "proposed", "suggested", "chosen", "done"),
    *("planned", "understood", "not understood", "understand me", "understand that"),
    *("understand it", "understand", "move", "moving", "moved", "go", "going", "work", "working"),
)
"""The verbs of a plan's making, or of its effect."""
SENDING = frozenset(
    (
        *("send", "sent", "sending", "pick", "picked", "picking", "choose", "chose", "chosen"),
        *("choosing", "use", "used", "using", "take", "took", "taken", "taking", "select"),
        *("selected", "selecting", "move", "moved", "moving", "dispatch", "dispatched"),
        *("dispatching", "plan", "planned", "order", "ordered", "propose", "proposed", "want"),
        *("suggest", "suggested", "go", "going", "goes", "flying", "driving", "fly", "drive"),
        *("proposing", "planning", "wanted", "leaving", "returning", "coming", "recalled"),
    )
)
"""The verbs of sending."""
INSTEAD_OF = ("and not", "instead of", "rather than", "but not", "over")
NOBODY = ("nobody", "no one", "no guard", "no guards", "no cover", "none", "nothing", "no asset")
GUARDED = ("covered", "guarded", "watched", "manned", "protected")
AT = ("standing at", "posted at", "stationed at", "left at", "at", "guarding", "covering",
      "watching", "on", "over", "for", "protecting")  # fmt: skip

ELSE = frozenset(("else", "instead", "otherwise", "differently", "alternatively"))
OTHER = ("other", "another", "different", "better", "alternative", "further", "second", "more")
OPTIONS = frozenset(
    (
        *("option", "options", "way", "ways", "plan", "plans", "idea", "ideas", "choice"),
        *("choices", "possibility", "possibilities", "suggestion", "suggestions", "proposal"),
        *("proposals", "solution", "solutions", "approach"),
    )
)
ALTERNATIVES = frozenset(("alternative", "alternatives", "options", "choices"))
"""The words for other plans by themselves."""
ARTICLES = ("any", "an", "a", "some", "the", "our", "my", "your", "all", "what", "which")
IS_THERE = (
    *("is there", "are there", "do you have", "do we have", "do i have", "have you got"),
    *("have we got", "have you", "have we", "got", "do you know", "do you see", "what are"),
    *("which are", "show me", "show us", "show", "give me", "list", "what about", "how about"),
    *("let me see", "can i see", "can you show me", "i want to see", "compare"),
)
WHOSE_TURN = ("you", "we", "i", "one", "the console", "the planner")
WOULD = frozenset(("would", "could", "can", "should", "might", "will", "do", "did", "'d", "may"))
DOING = (
    *("have done", "have suggested", "have planned", "do", "suggest", "propose", "recommend"),
    *("try", "advise", "have", "offer", "plan", "be done", "use", "send"),
)
INSTEAD_OF_IT = ("instead of it", "instead of that", "instead of this", "instead of the plan")
ABOUT_IT = (
    *("to do it", "to do this", "to do that", "to do so", "of doing it", "of doing this"),
    *("of doing that", "for this", "for that", "for it", "here", "about it", "about that"),
    *("about this", "besides it", "besides that", "left"),
    *("than that", "than this", "than it", "for me", "for us", "available", "on offer"),
    *("with that", "to this", "to that", "to it", "possible", "do we have", "do you have"),
    *("are there", "is there", "have we", "have you", "do i have", "would you suggest"),
)
