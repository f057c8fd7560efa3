"""Parameters of the node, which are also the arguments of its launch file."""

PARAMETERS = {
    "vehicles": (["A", "B"], "Names of the vehicles."),
    "ocean": (
        ["synthetic:beaufort"],
        "Ocean files, a cast, a synthetic ocean, or a TOML file with all settings.",
    ),
    "slot": (0.0, "Interval after which the next vehicle pings; 0: only if asked. [s]"),
    "time_origin": (0.0, "Stamp at which an ocean that varies begins. [s]"),
}
"""Default and meaning of each."""
