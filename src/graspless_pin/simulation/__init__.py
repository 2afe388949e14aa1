"""Simulation of a scene's rest in MuJoCo: the model of the scene, and the loading protocol."""

from graspless_pin.simulation.model import ContactModel, SimulationModel, simulation_model
from graspless_pin.simulation.protocol import (
    LoadingProtocol,
    SimulatedOutcome,
    SimulatedRun,
    Simulation,
    simulate,
)

__all__ = [
    "ContactModel",
    "LoadingProtocol",
    "SimulatedOutcome",
    "SimulatedRun",
    "Simulation",
    "SimulationModel",
    "simulate",
    "simulation_model",
]
