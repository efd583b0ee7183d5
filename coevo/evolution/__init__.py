"""Co-evolution: one population of trees for each robot, bred by DEAP, scored in games between them."""

from coevo.evolution.loop import GenerationReport, evolve
from coevo.evolution.population import Individual, first_population, random_teams
from coevo.evolution.variation import breed

__all__ = ["GenerationReport", "Individual", "breed", "evolve", "first_population", "random_teams"]
