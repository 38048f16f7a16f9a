"""Settings come back from what was stored, also by the names that they had then."""

import pytest

from paddlectl.agents.settings import restored
from paddlectl.learners.td3 import TD3Settings
from paddlectl.transfer.guidance import GuidanceSettings

OLDER_RULES = {
    "fading": 0.3,
    "curiosity": 0.01,
}


def test_older_names_are_read() -> None:
    assert restored(GuidanceSettings(), OLDER_RULES, "rules") == GuidanceSettings(
        similarity_decay=0.3,
        target_floor=0.01,
    )
    older = {"tracking": 0.5, "errands": 0.2, "errand_steps": 3.0}
    today = TD3Settings(tau=0.5, goal_exploration=0.2, goal_exploration_steps=3.0)
    assert restored(TD3Settings(), older, "low_level") == today


@pytest.mark.parametrize(
    "stored",
    [
        {"fading": 0.3, "similarity_decay": 0.3},
        {"fadin": 0.3},
        {"fading": "0.3"},
        {"lanes": 4},
        {"trials": 8},
    ],
)
def test_what_no_version_wrote_is_refused(stored: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"(rules|similarity_decay) (can't be|have no)"):
        restored(GuidanceSettings(), stored, "rules")
