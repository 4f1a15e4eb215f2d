// Only for the precompiled header of all programs.
