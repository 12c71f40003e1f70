"""The lab: the helicopter, the air around it, the cameras, the radio, and the time that computing takes."""
