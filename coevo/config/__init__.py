"""Settings: typed, frozen, and checked on the way in.

Every number of the world and of the experiments stands here once, with its unit in its name and its source in
its description. ``[T]`` marks a value stated in Uchibe (1999), ``[S]`` one from the RoboCup rules of 1997/98,
``[C]`` a free choice of ours where the text is silent.
"""

from coevo.config.effect import without_effect
from coevo.config.experiment import (
    CategorySettings,
    ConditionSettings,
    EvaluationSettings,
    EvolutionSettings,
    FitnessSettings,
    FitnessWeights,
    ForeignSettings,
    GameSettings,
    GPSettings,
    PlayerSettings,
    RunSettings,
    VaryingWeights,
    check_experiment,
)
from coevo.config.levels import ComplexitySettings, CriterionSettings, LevelsSettings
from coevo.config.reader import (
    FileSettings,
    NonNegative,
    Positive,
    Range,
    Settings,
    Share,
    assign,
    check,
    file_kind,
    override,
    read_toml,
    to_toml,
)
from coevo.config.world import (
    BallSettings,
    CameraSettings,
    FieldSettings,
    PhysicsSettings,
    RobotSettings,
    RuleSettings,
    StartSettings,
    WorldSettings,
)

__all__ = [
    "BallSettings",
    "CameraSettings",
    "CategorySettings",
    "ComplexitySettings",
    "ConditionSettings",
    "CriterionSettings",
    "EvaluationSettings",
    "EvolutionSettings",
    "FieldSettings",
    "FileSettings",
    "FitnessSettings",
    "FitnessWeights",
    "ForeignSettings",
    "GPSettings",
    "GameSettings",
    "LevelsSettings",
    "NonNegative",
    "PhysicsSettings",
    "PlayerSettings",
    "Positive",
    "Range",
    "RobotSettings",
    "RuleSettings",
    "RunSettings",
    "Settings",
    "Share",
    "StartSettings",
    "VaryingWeights",
    "WorldSettings",
    "assign",
    "check",
    "check_experiment",
    "file_kind",
    "override",
    "read_toml",
    "to_toml",
    "without_effect",
]
