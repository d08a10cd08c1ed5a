"""The static scene behind the action: background, light, camera shake, what lay still."""
