"""The methods on the lease, and the tokens by which a lease is shown."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from hmac import compare_digest
from typing import Any, TypedDict

from litegripd.control.authority import Grant, LeaseOptions
from litegripd.control.controller import Controller
from litegripd.model.errors import Refusal
from litegripd.model.plain import Carried
from litegripd.model.state import OnLost
from litegripd.rpc.jsonrpc import encode, notification_line
from litegripd.rpc.method import LEASE, Answer, Call, Deferred, Method, Param
from litegripd.rpc.reports import OwnerView, Reporter, StateView
from litegripd.rpc.sessions import Clients, not_permitted

NO_GRANT = 0
"""Grants are numbered from one: this number is none's, and so never the present one's."""


class Tokens:
    """Makes the token of a grant, a secret that its holder alone is given, and reads it.

    Only the latest grant has one: with it, every earlier grant is lost for good.
    """

    latest: Carried[tuple[int, str] | None] = None
    NOT_CARRIED = ("_new_token",)

    def __init__(self, new_token: Callable[[], str]) -> None:
        self._new_token = new_token

    def of(self, number: int) -> str:
        """Return the token of a grant, a new one for a new grant."""
        if self.latest is None or self.latest[0] != number:
            self.latest = number, self._new_token()
        return self.latest[1]

    def number(self, token: str) -> int:
        """Return the number of the grant that a token names, else `NO_GRANT`.

        How long it takes does not depend on how much of a wrong token is right.
        """
        if self.latest is None:
            return NO_GRANT
        number, secret = self.latest
        return number if compare_digest(token.encode(), secret.encode()) else NO_GRANT


class Holder(OwnerView):
    """Who has the lease, and how."""

    purpose: str | None
    since_s: float
    ttl_s: float | None
    on_lost: OnLost
    number: int


class LeaseView(TypedDict):
    """Who has the lease."""

    owner: Holder | None
    mine: bool
    waiting: int


class LeaseNumber(TypedDict):
    """The number of a lease."""

    number: int


class Granted(LeaseNumber):
    """A lease, and the token that proves it."""

    lease: str
    state: StateView


class Taken(Granted):
    """A lease that was taken: its former owner, the job that ended, and what the jaws do."""

    taken_from: Holder | None
    ended_job: int | None
    jaws: OnLost | None


class Released(TypedDict):
    """That a lease was given back."""

    released: bool


_PURPOSE = Param("purpose", "string", "What for; shown to everybody whom the lease refuses.")
_TTL = Param(
    "ttl_s",
    "number",
    "It is lost when its holder sends no request for so long (default: no limit).",
    minimum=0.1,
    maximum=86_400,
)
_ON_LOST = Param(
    "on_lost",
    "string",
    "What the jaws do when it is lost: keep the present hold, its force included (hold, the"
    " default), go slack (relax), or be disabled (disable).",
    choices=("hold", "relax", "disable"),
)
_GRANTED = "The token (lease), its number, and the state."


class LeaseMethods:
    """Methods on the controller's lease."""

    def __init__(
        self, controller: Controller, clients: Clients, tokens: Tokens, reporter: Reporter
    ) -> None:
        self._controller = controller
        self._clients = clients
        self._tokens = tokens
        self._reporter = reporter

    @Method(
        "lease.get",
        "Report who has the lease, and how many wait.",
        "owner (or null), waiting.",
        LeaseView,
    )
    def _get(self, call: Call) -> LeaseView:
        lease = self._controller.lease
        return {
            "owner": None if lease.holder is None else self._holder(lease.holder),
            "mine": lease.holder is not None and lease.holder.owner.client == call.owner.client,
            "waiting": lease.waiting,
        }

    def _holder(self, grant: Grant) -> Holder:
        owner, options = grant.owner, grant.options
        return {
            "client": owner.client,
            "pid": owner.pid,
            "uid": owner.uid,
            "program": owner.program,
            "purpose": options.purpose,
            "since_s": grant.since_s,
            "ttl_s": options.ttl_s,
            "on_lost": options.on_lost,
            "number": grant.number,
        }

    @Method(
        "lease.acquire",
        "Have the gripper for this connection alone, until lease.release or the connection's end.",
        _GRANTED,
        Granted,
        (
            _PURPOSE,
            _TTL,
            _ON_LOST,
            Param(
                "wait_s",
                "number",
                "How long to wait for it where it is not free, first come, first served (default"
                " 0).",
                minimum=0,
                maximum=86_400,
            ),
        ),
        role="operator",
        waits=True,
    )
    def _acquire(self, call: Call) -> Answer:
        holder = self._controller.lease.holder
        mine = holder is not None and holder.owner.client == call.owner.client
        before = holder.options if holder is not None and mine else LeaseOptions()
        options, wait_s = _lease_options(call.params, before), call.params.get("wait_s", 0.0)
        answer = self._controller.acquire(call.owner, options)
        if isinstance(answer, Grant) or wait_s == 0.0:
            return self._granted(answer)
        deferred = Deferred()
        refusal = self._controller.lease.wait(
            call.owner,
            options,
            self._controller.now_s,
            wait_s,
            lambda late: deferred.resolve(self._granted(late)),
        )
        return refusal or deferred

    @Method(
        "lease.release",
        "Give the lease back, if it is the present one; a running motion continues.",
        "released.",
        Released,
        (LEASE,),
        role="operator",
    )
    def _release(self, call: Call) -> Answer:
        return self._controller.release(call.owner) or Released(released=True)

    @Method(
        "lease.renew",
        "Restart the time to live, as every request of the holder does.",
        "The number of the lease.",
        LeaseNumber,
        (LEASE,),
        role="operator",
        needs_lease=False,
    )
    def _renew(self, call: Call) -> Answer:
        holder = self._controller.lease.holder
        refusal = self._controller.lease.refusal(call.owner)
        if refusal is not None or holder is None:
            return refusal or Refusal("lease_lost", "nobody has the lease: acquire one")
        self._controller.lease.renew(holder.owner.client, call.now_s)
        return LeaseNumber(number=holder.number)

    @Method(
        "lease.resume",
        "Get the lease of this token again after a lost connection, if nobody has had it since and"
        " no other client's motion runs.",
        _GRANTED,
        Granted,
        (replace(LEASE, required=True),),
        role="operator",
    )
    def _resume(self, call: Call) -> Answer:
        grant = call.owner.grant
        if grant is None:
            return Refusal("lease_lost", "a token is needed")
        holder = self._controller.lease.holder
        if holder is not None and holder.number == grant:
            whose = "this" if holder.owner.client == call.owner.client else "another"
            text = f"the lease of this token is not lost: {whose} connection has it"
            return Refusal("lease_held", text)
        return self._granted(self._controller.resume(grant, call.owner))

    @Method(
        "lease.take",
        "Take the lease from anyone who has it: of the same user, or as admin. A motion that runs"
        " ends, a detached one, too; what others have queued never begins. Who has lost by that, a"
        " lease or a motion without one, is informed, and moves nothing by its connection until it"
        " asks for the lease again.",
        "As of lease.acquire; from whom it was taken (taken_from, as the owner of lease.get, or"
        " null), the motion that has ended by it (ended_job, or null), and what the jaws do (jaws;"
        " null where the taker's own motion, or disabling, continues).",
        Taken,
        (
            Param("why", "string", "The reason, for the loser and the log.", required=True),
            Param(
                "jaws",
                "string",
                "What the jaws do now, whatever the loser wished: keep the present hold, its force"
                " included (hold, the default), go slack (relax), or be disabled (disable).",
                choices=("hold", "relax", "disable"),
            ),
            _PURPOSE,
            _TTL,
            _ON_LOST,
        ),
        role="operator",
        stop_voids=True,
    )
    def _take(self, call: Call) -> Answer:
        controller, params = self._controller, call.params
        holder, running = controller.lease.holder, controller.jobs.running
        in_the_way = controller.in_the_way()
        owners = [entry.owner for entry in (holder, in_the_way) if entry is not None]
        another = next((owner for owner in owners if owner.user != call.owner.user), None)
        if another is not None and call.session.role != "admin":
            text = (
                f"only an admin takes the gripper from another user: {another.program} (pid"
                f" {another.pid}, {another.user}) has it"
            )
            return not_permitted(call.session, "admin", text)
        left = params.get("jaws", "hold")
        grant, losses = controller.take_over(
            call.owner, _lease_options(params, LeaseOptions()), params["why"], left
        )
        for loss in losses:
            loser = self._clients.get(loss.owner.client)
            if loser is not None:  # else its motion has outlived it
                controller.lease.note_loss(loss)
                loser.write(notification_line("lease.lost", encode(loss.notice)))
        goes_on = controller.jobs.running
        taken: Taken = {
            **self._grant_view(grant),
            "taken_from": None if holder is None else self._holder(holder),
            "ended_job": None if running is None or goes_on is running else running.number,
            "jaws": left if goes_on is None else None,
        }
        return taken

    def _granted(self, answer: Grant | Refusal) -> Granted | Refusal:
        return answer if isinstance(answer, Refusal) else self._grant_view(answer)

    def _grant_view(self, answer: Grant) -> Granted:
        self._reporter.refresh()
        return {
            "lease": self._tokens.of(answer.number),
            "number": answer.number,
            "state": self._reporter.state_view(),
        }


def _lease_options(params: Mapping[str, Any], before: LeaseOptions) -> LeaseOptions:
    """Return the wanted options; what a holder does not name stays as it was."""
    return LeaseOptions(
        purpose=params.get("purpose", before.purpose),
        ttl_s=params.get("ttl_s", before.ttl_s),
        on_lost=params.get("on_lost", before.on_lost),
    )
