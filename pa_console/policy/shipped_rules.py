"""The shipped rules: their content's hash, and the core. Made by `rules pin --write`."""

# ruff: noqa: E501
# fmt: off

from pa_console.schema.rule import Ordering, Rule

NAME = 'checkpoint'
CONTENT_SHA256 = "cd0f16474d63de453b77f5fd1a798805ee4a304f32a13aff9cf30509d711a713"
"""The content that a set called NAME has when it is as shipped."""

CORE: tuple[Rule, ...] = (
    Rule(
        id='ROE-01',
        domain='ROE',
        priority='critical',
        text='Do not use lethal or violent force unless hostile intent is confirmed by sensor evidence.',
        tags=('force', 'intent'),
        check=r'''!mission.words.without(r"""(?x)
    # prohibitions, up to the next clause
    (?: n't | \b(?: dont | not | never | no | nobody | without | avoid | stop | cease | prevent
        | hold(?:\s+your)? | refrain\s+from | instead\s+of | rather\s+than ) )\s+
    (?: (?: to | be | ever | any | a | the | use\s+of | using | under\s+any\s+circumstances,?
          | attempt(?:ing)?\s+to | try(?:ing)?\s+to | start | begin | apply | resort\s+to )\s+ ){0,3}
    (?: shoot\w* | kill\w* | fire | firing | open(?:ing)?\s+fire | attack\w* | engag\w+
      | destroy\w* | eliminat\w+ | neutrali[sz]\w+ | ramm?(?:ing)? | harm\w* | hurt\w*
      | injur\w+ | lethal | deadly | violent | use | force | violence | weapons? | hit | crush
      | flatten | trample | squash | run\s+(?: over | down ) | beat\s+up
      | (?: drive | crash | fly | steer )\s+(?: [\w-]+\s+ ){0,4}? into
      | (?: set | light )\s+(?: [\w-]+\s+ ){1,4}? (?: on\s+fire | ablaze | alight ) )\b
    (?: (?! \b(?: and | but | then | until | unless | if | just | instead | so | only )\b )
        [^.,;:!?] )*
  | \bcease-?fire\b | \bnon-?\s?lethal\b(?:\s+force\b)?
    # what others do, try or threaten
  | \b(?: threaten | want | plan | intend | attempt )(?: s | n?ed | n?ing )\s+to\s+
    (?: use | open | blow | run | take )?\s*[\w-]+
  | \b(?: tries | tried | trying | prepares | prepared | preparing | plans | about | going )\s+to\s+
    (?: shoot | kill | attack | ram | destroy | bomb | open\s+fire | blow\s+up | harm | hurt )\b
  | \b(?: they | someone | somebody | intruders? | hostiles? | enem(?:y|ies) | attackers?
        | suspects? | gunm[ae]n | who )\s+
    (?: (?: may | might | could | would | will | can | also | now | again )\s+ ){0,2}
    (?: shoot | kill | attack | ram | destroy | bomb | use | throw | fire | open\s+fire )\b
  | \b(?: it | he | she )\s+(?: may | might | could )\s+
    (?: shoot | kill | attack | ram | destroy | bomb | use | throw | fire | open\s+fire )\b
  | \b(?: driver | man | men | people | person | persons | crowd | group | vehicles?
        | trucks? | cars? )\s+(?: may | might | could | would | will )\s+
    (?: shoot | kill | attack | ram | destroy | bomb | use | throw | fire | open\s+fire )\b
    # harmless objects and compounds
  | \bshoot\s+(?: (?: me | us | him | her | them | over | back | off )\s+ ){0,2}
    (?: (?: a | an | the | some | your | its | any | another | more )\s+ )?
    (?: (?: quick | short | brief | new | few | aerial | status | wide )\s+ ){0,2}
    (?: positions? | locations? | lists? | figures? | reports? | messages? | notes? | e-?mails?
      | updates? | photos? | pictures? | videos? | clips? | stills? | footage | film
      | summar(?:y|ies) | status | coordinates | images? | panoramas? | looks? | glances? )\b
  | \bshoot\s*:\s*(?: how | what | where | when | who | which | any )\b
    # what one would do for something, or does very well
  | \b(?: i | we )\s*(?: ['’]d | would | could )\s+kill\s+
    (?: for | to\s+(?: see | know | hear | have | get | be )\b )
  | \b(?: is | are | was | were | been | ['’]s | ['’]re )\s+killing\s+it\b
    # going somewhere in a hurry
  | \bshoot\s+(?: right | straight | quickly )?\s*
    (?: (?: over | across | along | through | round | around )\s+ (?: to | towards? )\s+
      | (?: up | down | out | back )?\s* \bto(?: wards? )?\s+
        (?= (?: the\s+ )?(?: [\w-]+\s+ )?
          (?: gates? | gatehouse | entrances? | exits? | base | depot | barriers? | yard
            | posts? | car\s+park )\b ) )
    (?! (?: kill | hit | hurt | wound | injure | harm | scare | frighten | warn | stop | halt
          | deter | disable | make | keep | get | protect | defend | clear | open | hold
          | save | secure )\b )
  | \bshoot\s+it\s+(?: straight\s+ )?(?: back | over | across )\s+to\s+
    (?! (?: hell | death | bits | pieces | the\s+stone ) )
    # what is done about somebody, or noted of them
  | \b(?: execute | terminate | destroy | eliminate | run\s+(?: over | down | through )
        | take\s+(?: down | out ) )\s+
    (?: (?! (?: and | then | or | with | who | that | in | at | on | by | to | for | from )\b )
        [\w-]+ (?: ['’]s? )? \s+ ){0,3}?
    (?: changes? | rotations? | rosters? | shifts? | handovers? | schedules? | plans?
      | procedures? | protocols? | checks? | search(?:es)? | inspections? | drills?
      | exercises? | routines? | workflows? | records? | logs? | lists? | plates?
      | registrations? | details | names? )\b
  | \bdrive\s+(?: [\w-]+\s+ ){0,4}? into\s+(?: [\w-]+\s+ )? car\s+park\b
  | \bkill\s+me\b
  | \bknock\s+it\s+off\b (?! \s+ (?: the | its | his | her | their )\b )
  | \bkill\s+(?: some | the )?\s*time\b | \bkill(?:ing)?\s+two\s+birds\b
  | \b(?: photo | film | movie | video | calendar | wedding | fashion | commercial | tv )\s+shoots?\b
  | \b(?: during | middle\s+of | after | before | until )\s+(?: a | the | our | their )\s+shoot\b
  | \bshoot-?outs?\b | \bkill[\s-](?: switch\w* | zone | chain | time )\b
  | \bkill\s+(?: (?: the | all | your | its | their | that )\s+ )*
    (?: [\w-]+\s+ )?
    (?: engines? | motors? | lights? | headlights? | floodlights? | power | feed | process
      | noise | sirens? | alarms? | radio | music | stream | rotors? | connection
      | chatter | speed | throttle | volume | mic(?:rophone)? | channel | screen | display )\b
  | \b(?: engage | attack )\s+[^.,;:!?]*?
    \b(?: in\s+(?: a\s+ )?(?: conversation | dialogue | talks? ) | verbally | politely
        | peacefully )\b
""").finds(r"""(?x)
    # violence whatever the object
    \b(?: shoot | kill | assassinate | slay | slaughter | annihilate | obliterate
        | exterminate | behead | maim | snipe | strangle | electrocute | strafe | napalm
        | incinerate | vapori[sz]e )\b
  | \bram\s+(?: the | that | this | these | those | any | every | it | him | her | them
      | his | their )\b
  | \btake\s+(?: the | your )\s+shot (?= \s*(?: [.,;:!?] | $ ) )
  | \btake\s+(?: a | some | your )?\s*shots?\s+at\s+(?: him | her | it | them | the | that | any )\b
  | \bboth\s+barrels\b
  | \bwith\s+(?: lead (?= \s*(?: [.,;:!?] | $ ) ) | live\s+(?: rounds? | ammunition | ammo ) )\b
  | \bopen\s+up\s+(?: on | upon )\s+(?: him | her | it | them
      | (?: the | that | those | any )\s+(?! hour ) )\b
  | (?: ^ | [.,;:!?]\s* | \b(?: and | then | to | please | just | now )\s+ ) (?: set | light )\s+
    (?: [\w-]+\s+ ){1,4}? (?: on\s+fire | ablaze | alight )\b
  | \b(?: break | smash | crush | snap )\s+(?: his | her | their | the\s+[\w-]+['’]s )\s+
    (?: [\w-]+\s+ )? (?: legs? | arms? | necks? | bones? | knees? | fingers? | skulls? | faces?
      | heads? | ribs? )\b
  | \bopen(?:ing)?\s+fire\b | \breturn\s+fire\b | \bfire\s+at\s+will\b
  | \bweapons\s+(?: free | hot )\b
  | \b(?: lethal | deadly )\s+(?: force | means | action )\b | \bby\s+force\b
  | \buse\s+(?: [\w-]+\s+ ){0,2}
    (?: tasers? | batons? | truncheons? | pepper\s+spray | tear\s?gas | knives | knife | rifles?
      | pistols? | flame-?throwers? | stun\s+guns? )\b
  | \b(?: use | using | apply | employ )\s+(?: [\w-]+\s+ ){0,3}
    (?: force(?: \s*$ | \s*[.,;:!?] | \s+(?: to | on | against | if | at | now )\b )
      | violence | firepower | weapons? | guns? | gunfire | firearms? | explosives? )
  | \bwith\s+(?: gunfire | bullets | full\s+force )\b
  | \bfire\s+(?: (?: a | the | your | its | some | all | two | three | \d+ )\s+ )?(?: warning\s+ )?
    (?: shots? | missiles? | rockets? | rounds? | weapons? | guns? | grenades? | mortars? )\b
  | \b(?: launch | throw | drop | lob )\s+(?: [\w-]+\s+ ){0,2}
    (?: missiles? | rockets? | strikes? | airstrikes? | attacks? | grenades? | bombs?
      | explosives? )\b
  | \b(?: start | begin | keep | continue | by | including | consider | try )\s+
    (?: shooting | firing\s+(?: at | on ) | killing )\b
  | ^(?: attack | engage | fire | charge )[.!\s]*$
    # verbs that are violent toward a person, a vehicle, a threat
  | (?: (?: ^ | [.,;:!?"(-]\s*
      | \b(?: to | please | then | and | or | must | should | shall | can | just | now | go
            | immediately | quickly | let's | all | (?: you | we | they )\s+will | you | we
            | drones? | uavs? | ugvs? | robots? | assets? | units? | team | everyone
            | [\w-]*_t\d+ | to\s+(?: immediately | quickly ) )\s+ )
    (?: attack | assault | strike | hit | bomb | blast | murder | massacre | burn | harm | hurt
      | wound | ram | engage | storm | shell | nuke | torch | club | trample | flatten | squash
      | waste | choke | fire\s+(?: at | on | upon ) )
      | \b(?: destroy | eliminate | neutrali[sz]e | terminate | liquidate | execute | crush
        | smash | pulveri[sz]e | cripple | drown | poison
        | stab | punch | injure | torture | tase | taser | blow\s+up | beat\s+up
        | take\s+out | take\s+down | crash\s+[\w-]+\s+into
        | wipe\s+out | knock\s+(?: out | down ) | run\s+(?: over | down )
        | (?: drive | roll )\s+(?: over | through ) | crash\s+into | dive\s+into
        | drive\s+into | finish\s+off | ramming | attacking | destroying | eliminating
        | neutrali[sz]ing | gun\s+down | mow\s+down
        | drop\s+(?: something | anything | (?: a | the | your | its )\s+(?: heavy\s+ )?
            (?: stone | brick | rock | load | payload | weight | drone | quad | robot ) )\s+
          (?: heavy\s+ )? (?: on | onto ) ) )\s+
    (?: him | her | it | them | everyone | everybody | anyone | anybody | everything | whoever
      | (?: (?: the | that | this | any | all | every | each | those | these | a | an | its
              | their | his | both | unknown | unidentified | suspicious | hostile | enemy
              | incoming | approaching | oncoming )\s+(?: [\w-]+\s+ ){0,3}? )?
        (?: vehicles? | cars? | trucks? | vans? | lorr(?:y|ies) | pick-?ups? | suvs? | sedans?
          | limousines? | limos? | hatchbacks? | coup[eé]s? | campers? | caravans? | minivans?
          | jeeps? | taxis? | (?: mini )?bus(?:es)? | coach(?:es)? | tractors? | trailers?
          | ambulances? | motorcycles? | (?: motor )?bikes? | bicycles? | scooters? | mopeds?
          | tanks? | convoys? | drivers? | riders? | cyclists? | pedestrians?
          | occupants? | passengers? | persons? | people | man | men | woman | women
          | guys? | blokes? | chaps? | fellows? | lads? | boys? | girls? | lad(?:y|ies) | drunks?
          | stewards? | bikers? | demonstrators? | kids? | child(?:ren)? | workers? | strangers?
          | bystanders?
          | individuals? | intruders? | hostiles? | enem(?:y|ies) | attackers? | targets?
          | threats? | suspects? | thie(?:f|ves) | robbers? | burglars? | smugglers?
          | rioters? | crowds? | protesters? | civilians? | soldiers? | troops?
          | combatants? | gunm[ae]n | insurgents? | terrorists? | trespassers? | visitors?
          | tracks? | contacts? | prisoners? ) )\b
  | \b(?: drive | steer | fly | dive | crash | slam | smash | plough | plow )\s+(?: [\w-]+\s+ ){1,4}?
    into\s+(?: him | her | them
      | (?: his | her | their )\s+(?: faces? | heads? | chests? | legs? | cars? | vans? | trucks? )
      | (?: the | that | this | any | every | a )\s+(?: [\w-]+\s+ ){0,2}?
        (?: vehicle | car | truck | van | lorry | bus | bike | motorcycle | convoy | driver
          | person | people | man | men | woman | women | intruders? | crowd | suspect
          | target ) )\b
  | \bput\s+(?: an? | some | two | three | \d+ )?\s*(?: bullets? | rounds? | slugs? )\s+
    (?: in | into | through )\b
  | \b(?: put | take )\s+(?: him | her | them )\s+down (?= \s*(?: [.,;:!?] | $ | (?: now | hard | immediately )\b ) )
  | \blight\s+(?: him | her | them )\s+up (?= \s*(?: [.,;:!?] | $ ) )
  | \b(?: blow | gun | mow | run | finish | beat | wipe | knock | bump )\s+(?: him | her | it | them
      | (?: the | that | this )\s+(?: [\w-]+\s+ ){0,2}?(?: vehicle | car | truck | driver | man
        | person | intruder | target | suspect | lorry | van | bus | bike | biker
        | motorcycle ) )\s+
    (?: up | down | over | off | out | away | apart
      | to\s+(?: bits | pieces | hell | smithereens ) )\b
  | \btake\s+(?: him | her | it | them | (?: the | that | this )\s+(?: [\w-]+\s+ ){0,2}?
      (?: vehicle | car | truck | lorry | van | driver | man | person | intruder | target
        | suspect ) )
    \s+out\s*(?: [.,;:!?] | $ | (?: now | immediately | please )\b )
    # violence that somebody or something is to suffer
  | \b(?: have | want | get | need | see )\s+
    (?: him | her | it | them
      | (?: the | that | this | those | his | her | their )\s+(?: [\w-]+\s+ ){0,2}?
        (?: vehicles? | cars? | trucks? | lorr(?:y|ies) | vans? | pick-?ups? | suvs? | bikes?
          | drivers? | man | men | woman | person | people | intruders? | suspects? | guys?
          | drunks? | blokes? | targets? )
        (?: \s+(?: at | by | near | in\s+front\s+of )\s+ (?: the\s+ )?(?: [\w-]+\s+ ){0,2}? [\w-]+ )? )\s+
    (?: shot | killed | destroyed | eliminated | wrecked | smashed | crushed | flattened | rammed
      | beaten | torched | burn(?:ed|t) | bombed | executed | liquidated
      | (?: run | knocked | gunned | mown | taken | blown )\s+(?: over | down | out | up ) )\b
  | \b(?: run | drive | roll )\s+over\s+(?: his | her | their )\s+(?: [\w-]+\s+ )?
    (?: foot | feet | toes? | legs? | hands? )\b
  | \b(?: turn | flip | tip )\s+(?: him | her | it | them )\s+(?: over\s+ )?on(?:to)?\s+
    (?: its | his | her | their )\s+(?: roof | side | back | head )\b
""") && !asks_for_force(mission.words)''',
        message='the mission asks for force; no command for force exists and none is derived from words',
    ),
    Rule(
        id='ROE-02',
        domain='ROE',
        priority='critical',
        text='Unknown vehicles or persons must be identified before escalation.',
        tags=('identity', 'escalation', 'block'),
        applies="actions.exists(a, a.verb == 'block')",
        check=r'''actions
  .filter(a, a.verb == 'block' && a.tracks.exists(t, t.identity == 'unknown'))
  .map(a, a.agent + ' at ' + a.target)''',
        message='identify the track before blocking it; its identity is unknown',
        order=(
            Ordering(kind='before', event='it.blocked && !it.other_threat', other="it.identity != 'unknown'", each='track', message='blocked before it was identified'),
        ),
    ),
    Rule(
        id='ROE-03',
        domain='ROE',
        priority='critical',
        text='Attempt de-escalation before containment or force.',
        tags=('de-escalation', 'warn', 'block'),
        applies="actions.exists(a, a.verb == 'block')",
        check=r'''actions
  .filter(a, a.verb == 'block' && a.tracks.exists(t, !t.warned))
  .map(a, a.agent + ' at ' + a.target)''',
        message='warn the track before blocking it; it has not been warned yet',
        order=(
            Ordering(kind='before', event='it.blocked && !it.other_threat', other='it.warned', each='track', message='blocked before it was warned'),
        ),
    ),
    Rule(
        id='ROE-05',
        domain='ROE',
        priority='critical',
        text='Operator instructions cannot override safety or ROE constraints.',
        tags=('override', 'instruction', 'safety'),
        check=r'''!mission.words.without(r"""(?x)
    \b(?: not | n't | never | without | nobody\s+(?: may | can ) | cannot | can't )\s+
    (?: [\w-]+\s+ )?(?: ignor\w+ | overrid\w+ | bypass\w* | disregard\w* | suspend\w*
      | violat\w+ | break\w* | circumvent\w* | forget\w* | disabl\w+ | skip\w* )\b
    [^.,;:!?]*
""").finds(r"""(?x)
    \b(?: ignore | ignoring | override | overriding | bypass | bypassing | disregard
        | disregarding | suspend | violate | violating | circumvent | forget | disable | skip
        | switch\s+off | turn\s+off )\s+
    (?: (?: all | any | every | the | your | these | those | this | that | of | previous | prior
          | standing | current | other | its )\s+ ){0,4}(?: [\w-]+\s+ ){0,2}?
    (?: rules? | roe | rules\s+of\s+engagement | polic(?:y|ies) | safeguards? | constraints?
      | safety | safety\s+(?: checks? | rules? | limits? ) | standoff | restrictions?
      | guardrails? )\b
  | \b(?: rules?(?:\s+of\s+engagement)? | roe | polic(?:y|ies) | safeguards? )\s+
    (?: do\s+not | don't | no\s+longer )\s+apply\b
  | \b(?: break | breaking )\s+(?: the | all | any | your )\s+
    (?: rules?(?:\s+of\s+engagement)? | roe | polic(?:y|ies) )\b
  | \b(?: regardless | irrespective )\s+of\s+(?: (?: the | all | any | your )\s+ ){0,2}
    (?: rules? | roe | polic(?:y|ies) | safety | safeguards? | constraints? )\b
""") && !asks_to_set_rules_aside(mission.words)''',
        message='the mission tells to set rules or safety aside, which no instruction can',
    ),
    Rule(
        id='ROE-09',
        domain='ROE',
        priority='critical',
        text='Potentially harmful actions must be justified by current sensor data.',
        tags=('sensor', 'evidence', 'block'),
        applies="actions.exists(a, a.verb == 'block' && size(a.tracks) > 0)",
        check=r'''actions
  .filter(a, a.verb == 'block' && a.tracks.exists(t,
    t.age_s > 10.0
    || (!actions.exists(b, b.kind == 'uav' && b.goes_to == a.target)
      && (t.stale || (size(t.observed_by) == 0 && size(t.seen_by) == 0
        && !gates.exists(g, g.name == a.target && g.covered_before))))))
  .map(a, a.agent + ' at ' + a.target)''',
        message='blocking a track needs sensor data of the last 10 s and a sensor on it',
    ),
    Rule(
        id='WF-03',
        domain='WF',
        priority='high',
        text='Maintain at least one asset assigned to each gate at all times.',
        tags=('coverage', 'gate'),
        check=r'''gates
  .filter(g, g.covered_before
    && (!g.covered_after || g.longest_gap_s > world.coverage_grace_s))
  .map(g, g.name + (g.covered_after
    ? ' uncovered for ' + brief(g.longest_gap_s) + ' s' : ' left uncovered')
    + (size(g.by) == 1 ? ' (only ' + g.by[0] + ' covers it)' : ''))''',
        message='every gate must stay covered',
        order=(
            Ordering(kind='within', event='it.covered', other='it.lost', each='gate', seconds='world.coverage_grace_s', message='uncovered for longer than the grace time'),
        ),
    ),
    Rule(
        id='CAP-01',
        domain='CAP',
        priority='high',
        text='UAVs are restricted to observation and reconnaissance.',
        tags=('uav', 'capability'),
        applies="actions.exists(a, a.kind == 'uav')",
        check=r'''actions
  .filter(a, a.kind == 'uav'
    && !(a.verb in ['hold', 'move_to', 'observe', 'return_to_base', 'report']))
  .map(a, a.agent + ' cannot ' + a.verb)''',
        message='a UAV only observes, moves, holds, reports and returns',
    ),
    Rule(
        id='CAP-06',
        domain='CAP',
        priority='high',
        text='Movement targets must correspond to predefined map frames.',
        tags=('frame', 'movement'),
        applies="actions.exists(a, a.target != '')",
        check=r'''actions.filter(a, a.target != '' && !(a.target in world.frames))
  .map(a, a.agent + ' to ' + a.target)''',
        message='the target is not a frame of this map',
    ),
)
"""Rules that no file can weaken, only add to (`core_rules.py`)."""
