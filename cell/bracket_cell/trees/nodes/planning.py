"""From the assembly graph to belief, guidance and the next placement (Alg. 1 lines 11-17)."""

from __future__ import annotations

from bracket_cell.trees.guard import Verdict
from bracket_cell.trees.nodes.services import CellNode, Services
from bracket_cell.trees.vocabulary import Hole, Part
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits
from btxml.engine.why import Decision, History


def open_steps(services: Services, state: AssemblyState) -> list[str]:
    """Placements and fastenings that are still to be done; of the most probable goal where slots may stay empty."""
    product, goal = services.tools.product, state.told_goal
    if product.varies and goal is None:
        goal = services.tools.infer(state, services.now.observation.operator.job).goal
    steps = product.steps(goal) if goal in product.goals else [*product.positions, *product.fastenings]
    return [step for step in steps if step not in state.placed and step not in state.fastened]


class InferGoal(CellNode):
    """Infer the goal and the plans of all objects from the graph (Alg. 1 lines 11, 14, 15).

    A work order that is open counts as what is expected; what is placed decides.
    """

    state = InputPort(AssemblyState, "what is placed so far")
    plan = OutputPort(AssemblyPlan, "belief over goals and next placements, and a plan for every object")

    _state: AssemblyState | None = None
    _plan: AssemblyPlan | None = None
    _variant: str | None = None

    def update(self) -> Status:
        state, job = self.state.get(), self.now.observation.operator.job
        variant = None if job is None else job.variant
        if self._plan is None or state != self._state or variant != self._variant:
            if self._state is None or state.placed != self._state.placed:
                self.memory.placed_s = self.now.observation.time_s
            self._plan = self.tools.infer(state, job)
            self._state, self._variant = state, variant
            self.tools.journal.note(
                "belief",
                placed=dict(state.placed),
                goals=dict(self._plan.goal_belief),
                goal=self._plan.goal,
                inference=self._plan.inference,
            )
        self.plan.set(self._plan)
        self.feedback_message = f"{self._plan.goal} ({self._plan.goal_belief[self._plan.goal]:.2f})"
        return Status.SUCCESS


class DecodeGuidance(CellNode):
    """Show for every object where it is still to be put, as far as all likely goals agree (Alg. 1 line 12)."""

    plan = InputPort(AssemblyPlan, "plan of every object")

    _shown: AssemblyPlan | None = None
    _words = ""

    def update(self) -> Status:
        plan = self.plan.get()
        if plan is not self._shown:
            self._shown = plan
            guidance, any_part = plan.shared(self.tools.guard.sure_probability, self.tools.product.positions)
            self.now.show(guidance=guidance, any_part=any_part, goal_belief=dict(plan.goal_belief))
            shown = {part: list(to) for part, to in guidance.items()}
            self.tools.journal.note("plan", guidance=shown, any_part=list(any_part))
            rows = {**guidance, **({"any part": any_part} if any_part else {})}
            self._words = "; ".join(f"{part}: {' '.join(to) or '-'}" for part, to in rows.items())
        self.feedback_message = self._words
        return Status.SUCCESS


class PredictNextObject(CellNode):
    """Predict the next object to fetch (Alg. 1 line 16)."""

    plan = InputPort(AssemblyPlan, "belief and plans")
    part = OutputPort(Part, "type of the part to fetch")

    def update(self) -> Status:
        part = self.plan.get().next_part
        if part is None:
            self.feedback_message = "nothing remains to be fetched"
            return Status.FAILURE
        self.part.set(Part(part))
        self.feedback_message = part
        return Status.SUCCESS


class DecodePlan(CellNode):
    """Decode the plan [o, p...] of the next object (Alg. 1 line 17)."""

    plan = InputPort(AssemblyPlan, "belief and plans")
    part = InputPort(Part, "type of the part to fetch")
    positions = OutputPort(list[str], "positions where it is still to be put, in order")

    def update(self) -> Status:
        part = self.part.get()
        positions = list(self.plan.get().guidance.get(part, ()))
        self.tools.journal.note("plan", next=[part, *positions])
        self.positions.set(positions)
        self.feedback_message = " ".join([part, *positions])
        return Status.SUCCESS if positions else Status.FAILURE


class ChoosePosition(CellNode):
    """Take the first position of the plan that the guard allows (Alg. 1 line 17)."""

    plan = InputPort(AssemblyPlan, "belief and plans")
    state = InputPort(AssemblyState, "what is placed so far")
    part = InputPort(Part, "type of the part to fetch")
    positions = InputPort(list[str], "positions of its plan, in order")
    position = OutputPort(Hole, "where it will be put")

    def update(self) -> Status:
        part = self.part.get()
        for position in self.positions.get():
            verdict = judge(self.services, self.plan.get(), self.state.get(), part, position)
            note_verdict(self.services, part, position, verdict.decision, verdict.reason)
            self.feedback_message, self.what_if = verdict.reason, verdict.otherwise
            if verdict.decision == "act":
                self.position.set(Hole(position))
                self.now.show(message=Message("fetching {part} for {position}", part=part, position=position))
                return Status.SUCCESS
            if verdict.decision == "ask":
                self.now.show(help_request=verdict.reason)
                if not self.now.observation.operator.present:  # else AskWhichGoal asks, and waits for the answer
                    self.tools.journal.note("help", text=verdict.reason)
                return Status.FAILURE
        self.now.show(message=Message("waiting: {reason}", reason=self.feedback_message))
        return Status.FAILURE


class CheckPlacement(CellNode):
    """Is this placement still right? (ticked again and again while the part is carried)

    What the wait for the person made cheap enough to begin stays so, when they place a part meanwhile.
    """

    node_type = "Condition"
    traits = Traits(guards=True, instant=True)

    plan = InputPort(AssemblyPlan, "belief and plans")
    state = InputPort(AssemblyState, "what is placed so far")
    part = InputPort(Part, "type of the part in the gripper")
    position = InputPort(Hole, "where it will be put")
    waited_s = InputPort(float, "how long the person had been waited for when it was begun", default=0.0, least=0)

    _verdict: Verdict | None = None

    def initialise(self) -> None:
        self._verdict = None

    def update(self) -> Status:
        part, position = self.part.get(), self.position.get()
        plan, state, waited_s = self.plan.get(), self.state.get(), max(self.waited_s.get(), self.services.waited_s)
        self._verdict = verdict = judge(self.services, plan, state, part, position, waited_s)
        if verdict.decision == "act":
            return Status.SUCCESS
        note_verdict(self.services, part, position, verdict.decision, verdict.reason)
        self.feedback_message = verdict.reason
        return Status.FAILURE

    def decision(self, answer: Status, history: History) -> Decision:
        """The guard's numbers, also where it agrees."""
        if self._verdict is None:
            return super().decision(answer, history)
        return Decision((), self._verdict.reason, self._verdict.otherwise)


class WithoutGuard(CellNode):
    """States in the file and in the log why what follows runs without a guard; succeeds."""

    node_type = "Condition"
    traits = Traits(guards=True, instant=True)

    reason = InputPort(str, "why that is safe")

    _noted = False

    def update(self) -> Status:
        self.feedback_message = f"no guard: {self.reason.get()}"
        if not self._noted:
            self.tools.journal.note(
                "verdict", subject="every placement", decision="unguarded", reason=self.reason.get()
            )
            self._noted = True
        return Status.SUCCESS


def judge(
    services: Services,
    plan: AssemblyPlan,
    state: AssemblyState,
    part: str,
    position: str,
    waited_s: float | None = None,
) -> Verdict:
    """The guard's verdict on one placement with what is seen in this tick.

    Args:
        waited_s: how long the person has been waited for; by default since a part was placed last.
    """
    kind, memory = services.tools.product.parts[part], services.memory
    if kind.made_of and memory.held_part != part and not services.built(part):
        words = Message("no {part} is built at {place}", part=part, place=kind.built_at)
        return Verdict("wait", words, f"if a {part} stood at {kind.built_at}")
    view = services.now.observation.bench
    reachable = services.reachable(part, position)
    present = services.now.observation.operator.present
    holes = view.holes if view else {}
    waited_s = services.waited_s if waited_s is None else waited_s
    return services.tools.guard.judge(plan, state, holes, part, position, reachable, present, waited_s)


def note_verdict(services: Services, part: str, position: str, decision: str, reason: str) -> None:
    """Write a verdict and its reason into the log."""
    services.tools.journal.note(
        "verdict",
        subject=f"{part} at {position}",
        part=part,
        position=position,
        decision=decision,
        reason=reason,
    )
