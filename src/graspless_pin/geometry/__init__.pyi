from .bodies.materials import Materials
from .bodies.object_and_supports import ManipulatedObject, Support
from .bodies.shapes import Box, Capsule, Cone, Cylinder, HalfSpace, MeshShape, Sphere
from .contact.contact_points import BodyKind, ContactPoint
from .inspection.audit import AuditReport, audit_urdf
from .inspection.listing import RobotRecord, list_robots
from .posing.closing import ClosingResult, close_hand
from .posing.fingertips import FingertipPlacement, place_fingertips
from .posing.overlaps import Overlap, unwanted_overlaps
from .posing.settling import settle_object
from .robots.description import FingerSpec, LinkMeshes

__all__ = [
    "AuditReport",
    "BodyKind",
    "Box",
    "Capsule",
    "ClosingResult",
    "Cone",
    "ContactPoint",
    "Cylinder",
    "FingerSpec",
    "FingertipPlacement",
    "HalfSpace",
    "LinkMeshes",
    "ManipulatedObject",
    "Materials",
    "MeshShape",
    "Overlap",
    "RobotRecord",
    "Sphere",
    "Support",
    "audit_urdf",
    "close_hand",
    "list_robots",
    "place_fingertips",
    "settle_object",
    "unwanted_overlaps",
]
