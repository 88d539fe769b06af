"""What elastic gears do to a robot: wind-up, the tool's place at rest, natural frequencies.

Everything follows from a rigid `InverseResult`; nothing here changes it.
"""
