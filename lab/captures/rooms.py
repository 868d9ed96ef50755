"""The rooms: which pieces of `assets/rooms` stand where.

Units are those of the KayKit characters, which are 2.4 tall.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lab.captures.shell import Shell

FOLDER = Path(__file__).parents[2] / "assets" / "rooms"

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Piece:
    """A glTF file below `assets/rooms`, turned about +y by `turn` degrees, then moved to `place`."""

    file: str
    place: Triple
    turn: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class Room:
    """Pieces, the place of the lamp, and linear RGB of what shows where nothing stands, below and above.

    shell: floor, walls and ceiling where the pieces have none.
    """

    pieces: tuple[Piece, ...]
    lamp: Triple
    shell: Shell | None = None
    sky: tuple[Triple, Triple] = ((0.30, 0.36, 0.42), (0.45, 0.62, 0.85))


def _kitchen() -> Room:
    def piece(name: str, *place: float, turn: float = 0.0) -> Piece:
        x, y, z = place
        return Piece(f"kaykit_restaurant/{name}.gltf", (x, y, z), turn)

    floor = [piece("floor_kitchen", x, -0.5, z) for x in (-4, 0, 4) for z in (-2, 2)]
    back = [
        piece("wall", -4, 0, -4.25),
        piece("wall_window_open", 0, 0, -4.25),
        piece("wall_orderwindow_decorated", 4, 0, -4.25),
    ]
    sides = [
        piece("wall_doorway", -6.25, 0, -2, turn=90),
        piece("wall_window_closed", -6.25, 0, 2, turn=90),
        piece("wall", 6.25, 0, -2, turn=-90),
        piece("wall", 6.25, 0, 2, turn=-90),
    ]
    row = [
        piece("fridge_A_decorated", -5, 0, -3),
        piece("kitchencounter_straight_A_decorated", -3, 0, -3),
        piece("kitchencounter_sink_backsplash", -1, 0, -3),
        piece("stove_multi_decorated", 1, 0, -3),
        piece("kitchencounter_straight_B_backsplash", 3, 0, -3),
        piece("kitchencabinet", -3, 0, -4),
        piece("extractorhood", 1, 0, -4),
        piece("crate", 5, 0, -2.6, turn=10),
        piece("food_burger", 3, 1, -3, turn=30),
    ]
    front = [
        piece("table_round_A_decorated", 3.4, 0, 0.8),
        piece("chair_A", 2.0, 0, 2.2, turn=140),
        piece("kitchentable_A_large_decorated", -3.4, 0, 0.6, turn=20),
        piece("chair_stool", -1.6, 0, 1.8),
        piece("pillar_A", 5.6, 0, 3.4),
    ]
    return Room((*floor, *back, *sides, *row, *front), lamp=(0.5, 3.8, 1.0))


def _living_room() -> Room:
    scale = 1.35

    def piece(name: str, *place: float, turn: float = 0.0) -> Piece:
        x, y, z = place
        return Piece(f"living_room/{name}.gltf", (scale * x, scale * y, scale * z), turn, scale)

    # the placement of Toyota Research Institute's furnished_living_room.dmd.yaml, with y up
    pieces = (
        piece("living_room", 0, 0, 0),
        piece("curtain_open", 0, 0, 0),
        piece("painted_wooden_cabinet_1k", -1.775, 0, -2.58),
        piece("wooden_bookshelf_worn_1k", 2.716, 0, 1.07, turn=-90),
        piece("painted_wooden_cabinet_02_1k", 0.0235, 0, -2.657),
        piece("sofa_03_1k", 0, 0, 2.41, turn=180),
        piece("painted_wooden_stool_1k", 1.774, 0, -1.63, turn=30),
        piece("wooden_table_02_1k", 1.5, 0, -0.3, turn=80),
    )
    return Room(pieces, lamp=(0.3, 3.9, 0.2))


def _dungeon() -> Room:
    def piece(name: str, *place: float, turn: float = 0.0) -> Piece:
        x, y, z = place
        return Piece(f"kaykit_dungeon/{name}.glb", (x, y, z), turn)

    floor = [piece("floor_tile_large.gltf", x, 0, z) for x, z in ((-4, 2), (0, -2), (0, 2), (4, -2))]
    floor += [piece("floor_tile_large_rocks.gltf", x, 0, z) for x, z in ((-4, -2), (4, 2))]
    walls = [
        piece("wall_archedwindow_gated.gltf", -4, 0, -4.5),
        piece("wall_shelves.gltf", 0, 0, -4.5),
        piece("wall_broken.gltf", 4, 0, -4.5),
        piece("wall_cracked.gltf", -6.5, 0, -2, turn=90),
        piece("wall.gltf", -6.5, 0, 2, turn=90),
        piece("wall_doorway_sides.gltf", 6.5, 0, -2, turn=-90),
        piece("wall.gltf", 6.5, 0, 2, turn=-90),
        piece("pillar_decorated.gltf", -5.6, 0, -3.6),
        piece("pillar.gltf", 5.4, 0, -3.4),
    ]
    furniture = [
        piece("banner_red.gltf", 2.6, 0.2, -4.5),
        piece("torch_mounted.gltf", -2.2, 2.2, -4.0),
        piece("barrel_small_stack.gltf", -3.6, 0, -2.9, turn=15),
        piece("crates_stacked.gltf", 3.6, 0, -2.3, turn=-20),
        piece("chest_gold", 1.3, 0, -2.6, turn=10),
        piece("table_medium_tablecloth_decorated_B.gltf", -3.3, 0, 0.9, turn=25),
        piece("chair.gltf", -1.9, 0, 1.5, turn=-120),
        piece("keg_decorated.gltf", 3.6, 0, 0.9, turn=-35),
        piece("stool.gltf", 1.9, 0, 1.9),
        piece("bed_decorated.gltf", -1.4, 0, -2.9, turn=90),
    ]
    return Room((*floor, *walls, *furniture), lamp=(-1.0, 3.6, 0.5))


def _bedroom() -> Room:
    def piece(name: str, *place: float, turn: float = 0.0) -> Piece:
        x, y, z = place
        return Piece(f"kaykit_furniture/{name}.gltf", (x, y, z), turn)

    pieces = (
        piece("bed_double_A", -2.6, 0, -2.2),
        piece("cabinet_small_decorated", -0.4, 0, -3.4),
        piece("lamp_standing", 0.7, 0, -3.3),
        piece("cabinet_medium_decorated", 2.6, 0, -3.3),
        piece("pictureframe_large_A", -2.6, 2.4, -4.0),
        piece("pictureframe_medium", 0.2, 2.3, -4.0),
        piece("shelf_B_large_decorated", 2.6, 2.2, -4.0),
        piece("rug_rectangle_stripes_A", 0.3, 0, 0.2, turn=10),
        piece("armchair_pillows", 3.4, 0, -0.4, turn=-50),
        piece("table_low", 3.0, 0, 1.9, turn=20),
        piece("lamp_table", 3.2, 0.5, 1.9),
        piece("chair_A_wood", -3.2, 0, 1.3, turn=60),
        piece("cactus_medium_A", -4.2, 0, 0.4),
        piece("book_set", 2.5, 0.75, 1.7, turn=-20),
    )
    return Room(pieces, lamp=(0.5, 3.6, 0.5), shell=Shell(5.0, 4.0, 4.0))


def _street() -> Room:
    scale = 3.0

    def piece(name: str, *place: float, turn: float = 0.0) -> Piece:
        x, y, z = place
        # the road's surface is 0.1 above the ground of the pieces
        return Piece(f"kaykit_city/{name}.gltf", (scale * x, scale * (y - 0.1), scale * z), turn, scale)

    roads = (
        piece("road_junction", 0, 0, 0),
        piece("road_straight_crossing", 2, 0, 0, turn=90),
        piece("road_straight", -2, 0, 0, turn=90),
        piece("road_straight", 0, 0, 2),
        piece("road_straight_crossing", 0, 0, -2),
    )
    buildings = (
        piece("building_A", 2, 0, 2),
        piece("building_C", -2, 0, 2, turn=90),
        piece("building_E", 2, 0, -2, turn=180),
        piece("building_H", -2, 0, -2, turn=-90),
        piece("building_B", 4, 0, 0, turn=-90),
        piece("building_D", -4, 0, 0, turn=90),
        piece("building_F", 0, 0, 4, turn=180),
        piece("building_G", 0, 0, -4),
    )
    things = (
        piece("car_taxi", 0.25, 0.17, -1.6),
        piece("car_hatchback", -1.7, 0.17, 0.25, turn=90),
        piece("car_police", 1.9, 0.17, -0.25, turn=-90),
        piece("streetlight", 0.8, 0.1, 0.8),
        piece("trafficlight_A", -0.8, 0.1, -0.8, turn=90),
        piece("firehydrant", -0.8, 0.1, 0.8),
        piece("bench", 0.85, 0.1, -0.85, turn=45),
        piece("dumpster", -0.3, 0.1, 1.7),
    )
    return Room((*roads, *buildings, *things), lamp=(2.0, 9.0, 4.0))


ROOMS: dict[str, Room] = {
    "kitchen": _kitchen(),
    "living_room": _living_room(),
    "dungeon": _dungeon(),
    "bedroom": _bedroom(),
    "street": _street(),
}
