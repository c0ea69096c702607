"""What no mission may ask for, in words that a list of violent verbs does not have.

Rules call these beside their own patterns, which are in English and literal: other languages,
euphemisms and idioms are here. Both functions read plain words (`plain_text.py`). What stands
behind a negation asks for the opposite, unless it is forborne that is ruled out: *do not refrain
from opening fire*. This is a net with holes: what it misses still meets a vocabulary without any
command for force, and checks that run whatever a mission says.
"""

import re
from collections.abc import Iterable

_PERSON = (
    r"(?:him|her|them|it|everyone|everybody|anyone|anybody"
    r"|(?:the|that|this|those|these|any|all|every)\s+(?:[\w-]+\s+){0,2}?"
    r"(?:m[ae]n|wom[ae]n|people|persons?|guys?|blokes?|drivers?|intruders?|trespassers?|strangers?"
    r"|suspects?|targets?|hostiles?|enem(?:y|ies)|visitors?|attackers?|crowd|soldiers?|civilians?))"
)
_HIM = _PERSON.replace("them|it|", "them|", 1)
_THING = (
    r"(?:it|them|(?:the|that|this|those|these|any|all|every)\s+(?:[\w-]+\s+){0,2}?"
    r"(?:vehicles?|cars?|trucks?|vans?|lorr(?:y|ies)|bus(?:es)?|bikes?|convoys?|jeeps?|pick-?ups?))"
)
_ARMS = (
    r"(?:force|violence|weapons?|guns?|fire|firing|shoot\w*|kill\w*|attack\w*|engag\w+|destroy\w*"
    r"|lead|bullets?|harm\w*|hurt\w*|ramm?\w*|trigger)"
)

_FORBORNE = re.compile(
    rf"""(?x)
    \b(?: n't | not | never | dont | without | no\s+need\s+to | no\s+reason\s+to | nobody )\s*
    (?: (?: to | be | you )\s+ )?
    (?: refrain\w* | hesitat\w+ | hold(?:ing)?\s+(?: back | off | your\s+fire ) | abstain\w*
      | shy(?:ing)?\s+away | shrink\w* | desist\w* | avoid\w* | spar(?: e | ing ) )\b
    [^.!?;]{{0,60}}? \b{_ARMS}\b
    """
)
_FORCE = re.compile(
    rf"""(?x)
    # death by another name
    \b(?: meet | meets )\s+(?: his | her | their | its | the )\s+maker\b
    | \bout\s+of\s+(?: his | her | their | its )\s+misery\b
    | \b(?: to | into )\s+(?: his | her | their | an\s+early | the )\s+graves?\b
    | \bsix\s+feet\s+under\b | \bin(?:to)?\s+a?\s*body\s*bags?\b
    | \bpush(?:es|ing)?\s+up\s+daisies\b
    | \bnever\s+(?: walks? | wakes? | breathes? | gets?\s+up | sees?\s+daylight )\s+again\b
    | \bstops?\s+breathing\b | \bmake\s+{_PERSON}\s+bleed\b
    | \b(?: end | take | snuff\s+out )\s+(?: the | his | her | their )\s+li(?: fe | ves )\b
    | \b(?: leave | show | give )\s+(?: [\w-]+\s+ ){{0,2}}?no\s+(?: survivors | quarter | mercy )\b
    | \bleave\s+(?: no\s*body | no\s+one | none | nothing )\s+(?: alive | breathing | standing )\b
    | \bextreme\s+prejudice\b
    | \b(?: dispose\s+of | get\s+rid\s+of | do\s+away\s+with | silence | remove | put\s+down
          | put )\s+{_PERSON}\s+(?: to\s+sleep\s+ )?(?: for\s+good | for\s+ever | forever
          | permanently | once\s+and\s+for\s+all )\b
    | \bdo\s+away\s+with\s+{_PERSON}
    | \b(?: bump | knock | rub | polish )\s+(?: off | out )\s+{_PERSON}
    | (?: ^ | [.,;:!?]\s* | \b(?: and | then | to | please | just )\s+ )
      (?: ice | whack | waste | smoke | cap | plug | frag )\s+{_HIM}
    | \bnever\s+(?: drives?\s+or\s+ )?walks?\s+again\b
    # bodies and machines as weapons
    | \b(?: strike | knock | bring )\s+(?: {_PERSON} | {_THING} )\s+(?: down | over | dead )\b
    | \b(?: crash | collide | smash | plough | plow )\s+(?: [\w-]+\s+ ){{0,2}}?
      (?: into | with | through )\s+(?: {_PERSON} | {_THING} )
    | \b(?: hits? | bumps? | rams? )\s+(?: [\w@-]+\s+ ){{1,6}}?
      (?: at\s+full\s+speed | full\s+speed | as\s+hard\s+as | hard\s+enough )\b
    | \bpin\s+{_THING}\s+[^.!?;]{{0,20}}?\bagainst\b
    | \b(?: break | crack )\s+(?: some | a\s+few | every | all )\s+(?: of\s+ )?
      (?: his\s+ | her\s+ | their\s+ )?(?: bones | ribs | legs | teeth )\b
    | \bphysical\s+destruction\b | \b(?: a | the )\s+fist\s+in\s+the\s+face\b
    # weapons by another name
    | \b(?: pull | squeeze )\s+the\s+trigger\b
    | \b(?: squeeze | loose | let | pop | crank )\s+off\s+(?: [\w-]+\s+ ){{0,3}}?
      (?: rounds? | shots? | bullets? )\b
    | \b(?: give | feed | serve )\s+(?: [\w'-]+\s+ ){{0,3}}?
      (?: (?: a | the | some | hot )\s+bullets? | bullets )(?! \s* - | \s+points? )\b
    | \b(?: give | feed | serve )\s+{_PERSON}\s+(?: some\s+ | hot\s+ )?lead\b
      (?! \s+(?: time | position | role | place ) )
    | \b(?: swallow | eat | taste )\s+(?: some\s+ | hot\s+ | the\s+ )?(?: lead | bullets? )\b
    | \b(?: pump | fill | shoot )\s+(?: [\w-]+\s+ ){{0,4}}?full\s+of\s+(?: holes | lead | bullets )
    | \briddled?\s+(?: [\w-]+\s+ ){{0,3}}?with\b
    | \b(?: unleash | raise )\s+hell\b
    | \brain(?:ing)?\s+(?: down\s+ )?(?: fire | hell | death | bullets | lead )\b
    | \blight(?:ing)?\s+(?: up\s+{_THING} | {_THING}\s+up | up\s+{_PERSON} )
      (?! \s+(?: with | by )\s+(?: (?: a | the | your | its )\s+ )?
          (?: [\w-]*lights?\b | lamps? | beam | torch ) )
    | \bas\s+an?\s+(?: [\w-]+\s+ )?(?: missile | bomb | projectile | battering\s+ram | weapon )\b
    | \b(?: kamikaze | suicide )\s+(?: (?: the | a | your )\s+ )?
      (?: drone | dive | run | attack | ugv | rover | robot )\b
    | \binto\s+(?: scrap | rubble | ashes | a\s+(?: wreck | pancake | coffin | pulp )
        | mincemeat )\b
    | \b(?: whatever | as\s+much | all\s+(?: the\s+ )?necessary | any(?:\s+amount\s+of)?
          | maximum | full )\s+force\b (?! \s+of\b )
      (?= \s*(?: [.,;:!?] | $ | it | is | you | as | to | against | on | necessary | needed ) )
    | \bby\s+(?: any | all )\s+means\s+necessary\b
    | \bcleared\s+hot\b
    """
)
_OTHERS_FORCE = re.compile(
    r"""(?x)
    # German, Dutch, Scandinavian
    \b(?: er | be | nieder | ab )?schie(?:ß|ss)(?: e | en | t )?\b (?! [-] )
    | \b(?: t[öo]e?te[nt]? | töte[nt]? )\s+(?: den | die | das | ihn | sie | alle[sn]? | jeden )\b
    | \bt[öo]tet\b | \bfeuer\s+frei\b | \b(?:er)?öffne[nt]?\s+das\s+feuer\b
    | \bvernichte\w*\b | \bzerst[öo]r\w+\b | \bgreift?\s+[^.!?;]{0,40}?\ban\b | \bangreif\w+\b
    | \b[üu]berfahr\w+\b | \bsprengt?\s+(?: den | die | das | ihn | sie )\b
    | \brammt?\s+(?: den | das | die )\b
    | \bbringt?\s+[^.!?;]{0,30}?\bum\b | \bgewalt\s+(?: an | gegen )\w*\b | \bermord\w+\b
    | \bschiet(?: en )?\b | \b(?:neer)schiet\w* | \bvermoord\w*\b | \bvernietig\w*\b
    | \bdood\s+(?: de | hem | haar | die | iedereen )\b | \bopent?\s+het\s+vuur\b
    | \bskjut\w*\b | \bdöda\b | \bskyd\w*\b | \bskyt\b | \bdræb\w*\b | \bdrep\b | \bammu(?: kaa )?\b
    # French, Spanish, Italian, Portuguese, Romanian
    | \btire[zr]?\s+(?: sur | dans )\b | \btirez\b | \btue[zr]\b
    | \btue\s+(?: le | la | les | ce | l' ) | \babatt(?: ez | re )\b | \babats\b
    | \bouvr(?: e[zr]? | ir )\s+le\s+feu\b | \bfaites\s+feu\b | \bfeu\s+à\s+volonté\b
    | \battaque[zr]?\s+(?: le | la | les | l' | ce )\b | \bdétrui(?: s | sez | re )\b
    | \bécrase[zr]?\b | \b(?: élimine[zr]? | (?: neutralise | fusille | assassine )[zr] )\b
    | \bdispar(?: a | e | en | ad | ar | ale | ales | arle )\b
    | \bm[aá]t(?: a | en | ad | ar )\s+al?\b | \bmate\s+al\b
    | \bm[aá]t(?: a | e | en )l[oae]s?\b | \babr(?: e | an | a | ir | id )\s+fuego\b
    | \b(?: atac | ataqu )\w+\s+(?: al | a | el | la | los )\b | \bdestruy\w+\b | \bdestruir\b
    | \batropell\w+\b | \basesin(?: a | e | en | ar )\b | \bfuego\s+a\s+discreción\b
    | \bspara(?: te | re | gli | tegli )?\b | \buccid\w+\b | \bammazz\w+\b
    | \bapr(?: i | ite | ire )\s+il\s+fuoco\b
    | \babbatt(?: i | ete | ere | etelo )\b | \bdistrugg\w+\b
    | \battacca(?: te | re )?\s+(?: il | lo | la | i | l' )
    | \batir(?: e | em | ar )\s+(?: n[oa]s? | em | contra )\b
    | \bmat(?: e | em | ar )\s+(?: o | os )\b
    | \babr(?: a | am | ir )\s+fogo\b | \batropel\w+\b | \bdestrua\w*\b
    | \bucide\w*\b | \bomoar\w+\b | \bîmpuș\w+\b
    # Polish, Czech, Russian, Ukrainian
    | \bzastrzel\w*\b | \bstrzelaj\w*\b | \bzabij\w*\b | \bzabić\b | \botw[óo]rz\w*\s+ogień\b
    | \bzaatakuj\w*\b | \bzniszcz\w*\b | \brozjed\w+\b | \bzastřel\w*\b | \bstřílej\w*\b
    | \b(?: стреля | застрел | расстрел | уничтож | атаку | атакова | ликвидир | взорви | задави
        | тарань | протарань | обстреля )\w*\b
    | \bубе[йй]\w*\b | \bубить\b | \bоткр\w+\s+огонь\b | \bогонь\s+(?: по | на )\b
    | \b(?: стріля | застрел | знищ | атакуй )\w*\b | \b[ву]бий\w*\b | \bвідкр\w+\s+вогонь\b
    # Turkish, Greek, Hungarian, Indonesian, Vietnamese
    | \bateş\s+(?: et | ed | aç )(?! me )\w*\b | \böldür(?! me )\w*\b | \bvur(?: un )?\b
    | \bsaldır(?! ma )\w*\b
    | \bπυροβ[οό]λ\w*\b | \bσκ[οό]τ[ωώ]\w*\b | \blőj\w*\b | \böld\s+meg\b
    | \btembak\w*\b | \bbunuh\w*\b | \bhancurkan\b | \bbắn\b | \bgiết\b | \bnổ\s+súng\b
    # Arabic, Hebrew, Persian, Hindi
    | [أا]طلق\w*\s+النار | افتح\w*\s+النار | \bاقتل\w*\b | \bهاجم\w*\b | \bدم[ّ]?ر\w*\b
    | \bתירה\b | \bתירו\b | \bהרוג\b | \bחסל\b | شلیک | \bبکش\w*\b
    | गोली\s+(?: मार | चला ) | मार\s+(?: डालो | दो ) | हमला\s+कर
    # Chinese, Japanese, Korean, Thai
    | 开枪 | 開槍 | 开火 | 開火 | 射击 | 射擊 | 射杀 | [杀殺](?: 死 | 了 | 掉 | 害 | 光 | 他 | 她 )
    | 击毙 | 擊斃 | 消灭 | 消滅
    | 攻击 | 攻擊 | 撞死 | 打死 | 炸[死毁掉] | 摧毁 | 摧毀
    | 撃[てつち] | 射殺 | 殺[せしす] | 攻撃 | 発砲 | 破壊
    | 쏴 | 쏘[아세] | 사살 | 죽[여이] | 공격 | 발포 | 파괴 | ยิง | ฆ่า | โจมตี
    """
)

_RULE = (
    r"(?:rules?(?:\s+of\s+engagement)?|rule\s?books?|roe|polic(?:y|ies)|safeguards?|guard\s?rails?"
    r"|restrictions?|constraints?|protocols?|regulations?|standoff"
    r"|safety(?:\s+(?:checks?|limits?|rules?))?|(?:roe|wf|cap|sec|com)-?\d+)"
)
_WHICH = (
    r"(?:(?:the|all|any|every|each|your|our|these|those|this|that|of|standing|usual|other|about"
    r"|single)\s+){0,4}"
)
_ASIDE = re.compile(
    rf"""(?x)
    \b(?: whatever | no\s+matter\s+what )\s+(?: the\s+ )?{_RULE}\b
    | \b(?: pretend | imagine | act\s+as\s+if | as\s+if | as\s+though | suppose | assume )\b
      [^.!?;]{{0,30}}? \b(?: no\s+{_RULE} | {_RULE}\b[^.!?;]{{0,20}}?
        \b(?: not | no | never | don't | doesn't | did\s*n't | off | gone ) )\b
    | (?: ^ | \b(?: as | because | since | so | now | today | therefore | hereby )\s+ )
      {_WHICH}{_RULE}\s+(?: (?: is | are | has\s+been | have\s+been | was | were )\s+ )
      (?: (?: all | now | hereby | temporarily )\s+ )?
      (?: suspended | lifted | off | void | cancelled | canceled | waived | disabled | overridden
        | overruled | revoked | null | optional )\b
    | \b{_RULE}\s+(?: off | suspended | void | notwithstanding | aside | out\s+of\s+ (?: force
        | function ) )\b (?! \s+(?: the | its | limits? )\b )
    | \b(?: checks | safeguards | (?: safety\s+ )?limits )\s+(?: off | released | disabled )\b
    | \b{_RULE}\s+(?: no\s+longer | don't | do\s+not )\s+appl(?: y | ies )\b
    | \b{_RULE}\s+(?: [\w-]+\s+ ){{0,3}}?(?: is | are )\s+(?: [\w-]+\s+ )?
      (?: void | out\s+of\s+(?: force | function | order ) )\b
    | \b(?: disable | delete | erase | remove | outside | deviate\s+from | notwithstanding | despite
          | around | past )\s+{_WHICH}(?: {_RULE} | checks )\b
    | \b(?: without | no )\s+(?: any\s+ )?(?: regard | respect | consideration )\s+
      (?: to | for | of )\s+{_WHICH}{_RULE}\b
    | \b(?: not | n't )\s+(?: look\s+at | care\s+about | consult | mind | heed )\s+{_WHICH}{_RULE}\b
    | \bcommand\s+override\b | \boverride\s+codes?\b
    | \b{_RULE}\s+(?: do | does | did )\s*(?: n't | \s+not )\s+(?: exist | matter | count | bind
        | concern )\b
    | \bwithout\s+{_WHICH}(?: {_RULE} | approvals? | (?: safety\s+ )?checks )\b
    | \b(?: skip | skipping | waive | drop | ditch | scrap | defy | flout | neglect | evade
          | sidestep | dodge | deactivate | lift )\s+
      {_WHICH}(?: {_RULE} | approvals? | checks )\b
    | \b(?: set | put | leave | lay | push | throw | cast )\s+{_WHICH}{_RULE}\s+
      (?: aside | away | apart | out )\b
    | \bset\s+aside\s+{_WHICH}{_RULE}\b
    | (?: ^ | [.,;:!?]\s* )no\s+(?: more\s+ )?(?: rules | roe | restrictions | safeguards )
      (?! \s+(?: is | are | was | were | say\w* | have | apply\s+to\s+th ) )\b
    | \b(?: never\s+mind | forget | to\s+hell\s+with | screw | damn | sod | who\s+cares\s+about
          | stop\s+ (?: worrying | caring )\s+about )\s+(?: about\s+ )?{_WHICH}{_RULE}\b
    | \b(?: don't | do\s+not )\s+(?: worry | care | bother | think | trouble )\s+
      (?: yourself\s+ )?(?: about | with | over )\s+{_WHICH}{_RULE}\b
    | \b(?: stop | cease | quit )\s+(?: enforcing | checking | following | obeying | applying
          | observing | respecting | using )\s+{_WHICH}{_RULE}\b
    | \b(?: break | breaking | bend | bending | breach )\s+{_WHICH}(?: {_RULE} )\b
    | \b(?: obey | listen\s+to | answer\s+to | follow )\s+(?: only\s+me | me\s+only
          | nobody\s+but\s+me | me\s+alone )\b
    | \b(?: not\s+(?: be\s+ )?bound\s+by | no\s+longer\s+bound\s+by | instead\s+of | free\s+of
          | exempt\s+from )\s+{_WHICH}{_RULE}\b
    | \b(?: enter | switch\s+to | go\s+into | activate | enable | in )\s+(?: an?\s+ | the\s+ )?
      (?: god | developer | debug | unrestricted | unsafe | jailbreak | admin | override )\s+mode\b
    """
)
_OTHERS_ASIDE = re.compile(
    r"""(?x)
    \b(?: ignorier | missacht | vergiss | vergesst | umgeh | brich | brecht | negeer | vergeet
        | ignorera | strunta )\w*\s+[^.!?;]{0,30}?
      \b(?: \w*regeln? | vorschrift\w* | richtlinie\w* | beschränkung\w* | sicherheit\w* | regels
        | regler\w* )\b
    | \bregeln?\s+gelten\s+(?: \w+\s+ )?nicht\b
    | \bohne\s+rücksicht\s+auf\s+(?: die\s+ )?\w*regeln\b
    | \b(?: ignore[zr]? | oublie[zr]? | contourne[zr]? | enfrei\w+ | viole[zr]? )\s+[^.!?;]{0,20}?
      \b(?: règles? | regles? | consignes? | restrictions? | sécurité )\b
    | \b(?: ignor | olvid | omit | sált | salt | viol | romp | desobede )\w*\s+[^.!?;]{0,20}?
      \b(?: reglas? | normas? | políticas? | restricciones )\b
    | \b(?: ignor | dimentic | viol | infrang )\w*\s+[^.!?;]{0,20}?\b(?: regole | regola | norme )\b
    | \b(?: ignor | esque[çc] | viol )\w*\s+[^.!?;]{0,20}?\b(?: regras? | restrições )\b
    | \bz?ignoruj\w*\s+[^.!?;]{0,20}?\b(?: zasad\w* | reguł\w* | przepis\w* )\b
    | \b(?: игнориру | забуд | наруш | обойди | проигнорируй | отключи )\w*\s+[^.!?;]{0,20}?
      \b(?: правил\w* | ограничени\w* | инструкци\w* )\b
    | \b(?: ігноруй | забудь | поруш )\w*\s+[^.!?;]{0,20}?\bправил\w*\b
    | \bkural\w*\s+[^.!?;]{0,12}?(?: yok\s+say | görmezden | boş\s*ver | unut | çiğne )
    | (?: 忽略 | 无视 | 無視 | 忘记 | 忘掉 | 绕过 | 繞過 | 违反 | 違反 | 不管 | 不顾 ).{0,6}?
      (?: 规则 | 規則 | 规定 | 規定 | 政策 | 限制 )
    | (?: 規則 | ルール | 制限 ).{0,3}?(?: 無視 | 破っ | 破れ )
    | (?: 규칙 | 제한 ).{0,4}?(?: 무시 | 어기 | 어겨 )
    | (?: تجاهل | انس | اكسر ).{0,12}?(?: قواعد | التعليمات | القيود )
    """
)
_PEOPLE = (
    r"(?:(?:the|that|this|those|these|any|all|every|each|both|a|an|two|three|our)\s+(?:[\w-]+\s+){0,2}?"
    r"(?:m[ae]n|wom[ae]n|people|persons?|guys?|blokes?|fellows?|lads?|boys?|girls?|kids?"
    r"|child(?:ren)?|famil(?:y|ies)|drivers?|riders?|passengers?|occupants?|pedestrians?|cyclists?"
    r"|intruders?|trespassers?|strangers?|suspects?|hostiles?|enem(?:y|ies)|visitors?|attackers?"
    r"|thie(?:f|ves)|burglars?|robbers?|crowds?|protesters?|demonstrators?|rioters?|civilians?"
    r"|soldiers?|refugees?|workers?|bystanders?|individuals?|prisoners?|drunks?))"
)
_SOMEONE = rf"(?:him|her|them|whoever|(?:any|every|some)(?:one|body)(?!\s+else)|{_PEOPLE})"
_HE = rf"(?:he|she|{_PEOPLE})"
_SHUT = r"(?:box|pen|hem|fence|wall|lock|shut|seal|coop|brick|bar|close|barricade)"
_OUT = (
    r"(?:leav(?:e|ing)|escap(?:e|ing)|flee(?:ing)?|(?:get|getting)\s+(?:out|away))\b"
    r"(?!\s+(?:the|their|its|his|her|our|your|any|an?)\s+(?:[\w-]+\s+)?"
    r"(?:gates?|posts?|places?|positions?|stations?)\b|\s+\w*gate\b)"
)
_CONFINEMENT = re.compile(
    rf"""(?x)
    # shut in
    \b{_SHUT}\s+{_SOMEONE}\s+(?: off\s+)?(?: in | inside | up )\b
      (?! \s+(?: view | sight | frame | focus | the\s+(?: view | picture | list | log ) )\b )
    | (?: ^ | [.,;:!?]\s* | \b(?: and | then | to | please | just | now | [\w-]*_t\d+ )\s+ )
      (?: cordon | ring | circle | besiege | entrap | ensnare | intern | contain | immobili[sz]e )
      \s+{_SOMEONE}
    | \b(?: trap | corner | surround | encircle | confine )\s+and\s+[\w-]+\s+{_SOMEONE}
    | \b(?: keep | hold | lock )\s+{_SOMEONE}\s+inside\b
    | \b{_HE}\s+(?: is | are | must | has | have )\s+(?: to\s+ )?be\s+
      (?: kept | held | locked | shut )\s+(?: in | inside )\b
    | \b(?: lock | shut | close | seal )\s+(?: [\w-]+\s+ ){{0,4}}?(?: with | while | and\s+keep )\s+
      {_HE}\s+(?: (?: is | are | still )\s+ ){{0,2}}inside\b
    # between, around, on all sides
    | \b(?: hem | box | pen | wedge | sandwich | pin | squeeze | catch | hold )\s+{_SOMEONE}\s+
      (?: in\s+ )?between\b
    | \b{_SOMEONE}\s+(?: stuck | wedged | sandwiched | pinned | caught )\s+(?: in\s+ )?between\b
    | \b(?: herd | drive | push | force | back )\s+{_SOMEONE}\s+into\s+(?: a | the )\s+corner\b
    | \b(?: circle | ring | cordon | cage | wall | prison | trap )\s+(?: a?round | about | for )\s+
      {_SOMEONE}
    | \b(?: every | each | all | both )\s+(?: the\s+ )?(?: exits? | sides? | ways?(?:\s+out)? )\s+
      (?: a?round | of | for )\s+{_SOMEONE}
    | \b(?: in\s+front\s+of | before )\s+and\s+behind\s+{_SOMEONE}
    | \bbehind\s+and\s+(?: in\s+front\s+of | before )\s+{_SOMEONE}
    # no way out
    | \b(?: no\s*where | no\s+place )\s+to\s+(?: go | run | flee | turn )\b
    | \b(?: no | without\s+an? )\s+(?: exit | escape | way\s+out )\s+for\s+{_SOMEONE}
    | \bagainst\s+(?: his | her | their )\s+will\b
    | \b{_HE}\s+(?: must | may | shall | should | can | could | do | does )\s*
      (?: not | n't | never )\s+{_OUT}
    | \b{_HE}\s+(?: is | are )\s*(?: not | n't )\s+(?: to | allowed\s+to )\s+{_OUT}
    | \b(?: not | n't | never )\s+(?: allow | permit | want )\s+{_SOMEONE}\s+(?: to\s+ )?
      (?: {_OUT} | go(?:ing)?\s+anywhere )
    | \bso\s+(?: that\s+ )?{_HE}\s+(?: is | are | gets? | stays? | remains? )\s+
      (?: stuck | trapped | there | put | inside | caught )\b
    | \b(?: stop | prevent | keep | hinder )\s+{_SOMEONE}\s+(?: from\s+ )?{_OUT}
    | \b(?: not | n't | never )\s+let\s+{_SOMEONE}\s+(?: {_OUT} | out\b (?! \s+of\s+(?: sight
        | view ) ) )
    """
)
_NOT = re.compile(
    r"(?:\b(?:not|never|no|nobody|none|without|cannot|dont|avoid|stop|refrain\s+from|instead\s+of"
    r"|rather\s+than|ne|nicht|kein\w*|nie|niemals|niet|geen|non|não|nao|не|ни|нельзя|nie|inte"
    r"|ikke|jamais|nunca|mai)\s+|n't\s+|\bn'|(?:不要|不准|不得|不许|禁止|别|別|勿|不)|\bلا\s+)"
    r"(?:[\w'-]+\s+){0,3}$"
)
_NOT_AFTER = re.compile(
    r"^\s*(?:[\w'-]+\s+){0,2}?(?:nicht|niet|pas|jamais|inte|ikke|nicht\w*)\b"
    r"|^.{0,4}(?:するな|ないで|てはいけ|禁止|지\s*마|금지|जाए\s+नहीं)"
)


def asks_for_force(words: str) -> bool:
    """Return whether plain `words` ask for violence in other languages, idioms or euphemisms."""
    if _FORBORNE.search(words) is not None:
        return True
    return _meant(words, (_FORCE, _OTHERS_FORCE))


def asks_to_confine(words: str) -> bool:
    """Return whether plain `words` ask to shut a person in, by idioms and by what follows."""
    return _meant(words, (_CONFINEMENT,))


def asks_to_set_rules_aside(words: str) -> bool:
    """Return whether plain `words` ask to set rules or safety aside, in any wording."""
    return _meant(words, (_ASIDE, _OTHERS_ASIDE))


def _meant(words: str, patterns: Iterable[re.Pattern[str]]) -> bool:
    """Return whether one of the `patterns` stands in `words` and is not negated there."""
    for pattern in patterns:
        for found in pattern.finditer(words):
            before = re.split(r"[.,;:!?]", words[: found.start()])[-1]
            if not _NOT.search(before) and not _NOT_AFTER.search(words[found.end() :]):
                return True
    return False
