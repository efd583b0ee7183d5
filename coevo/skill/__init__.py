"""Learned skills: data on disk, a bank of them for compiled code, and how one estimates its state and acts."""

from coevo.skill.bank import SkillBank, make_bank
from coevo.skill.model import (
    ObjectModel,
    Skill,
    installed_skills,
    load_skill,
    read_card,
    skill_description,
    skill_path,
)
from coevo.skill.world import check_world

__all__ = [
    "ObjectModel",
    "Skill",
    "SkillBank",
    "check_world",
    "installed_skills",
    "load_skill",
    "make_bank",
    "read_card",
    "skill_description",
    "skill_path",
]
