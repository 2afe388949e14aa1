"""What MuJoCo says of a scene's rest: a model of the scene, and a protocol to simulate it by."""

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
