// Only for the precompiled headers of all libraries.
