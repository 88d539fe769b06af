"""What is there: scene, robot, twin, bearings, laws, drives."""
