# SPDX-License-Identifier: Apache-2.0
"""Materials of the town, and what a row of the instance table means for each of them."""

#: Per-triangle material ids.
GROUND, FACADE, ROOF, FOLIAGE, BARK, PAINT, GLASS, WOOD, PLAIN_WALL, CONCRETE = range(10)

#: Columns of an instance row (float32). Every row begins with a colour (0..2, linear) and a seed
#: (3).
COLUMNS = 16
SEED = 3
# facades
BAY_M, FLOOR_M, WINDOW_WIDTH_M, WINDOW_HEIGHT_M, SILL_M = 4, 5, 6, 7, 8
FLOORS, BRICK, DOOR_BAY, TRIM, BAYS = 9, 10, 11, 12, 15  # TRIM: a colour, 12..14
# foliage: centre (4..6) and radius of the crown
CENTRE, RADIUS = 4, 7
