"""Co-evolution: one population of trees for each robot, bred by DEAP, scored in games between them."""

from coevo.evolution.loop import GenerationReport, evolve
from coevo.evolution.population import Individual, breed, first_population, random_teams

__all__ = ["GenerationReport", "Individual", "breed", "evolve", "first_population", "random_teams"]
