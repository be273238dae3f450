"""Settings of viewers for the bag of a run: a layout of Foxglove, a configuration of RViz."""

from __future__ import annotations

import json

LATCHED = ("/road", "/map")


def foxglove(members: int, grid: bool, followed: str) -> str:
    """A layout with the scene from above, and speeds over time. JSON.

    members  : number of them
    grid     : whether there is a map of what is occupied
    followed : frame that the view follows
    """
    shown = ["/road", "/vehicles", "/traffic", "/targets", *(["/map"] if grid else [])]
    topics = {topic: {"visible": True} for topic in shown}
    topics |= {
        f"/scan{i}": {"visible": True, "pointSize": 3, "colorMode": "flat", "flatColor": "#d0304a"}
        for i in range(members)
    }
    scene = {
        "layers": {"grid": {"layerId": "foxglove.Grid", "visible": False, "size": 100, "divisions": 10}},
        "cameraState": {"perspective": False, "distance": 80, "phi": 0, "thetaOffset": 0, "targetOffset": [0, 0, 0]},
        "followMode": "follow-position",
        "followTf": followed,
        "scene": {"enableStats": False},
        "topics": topics,
    }
    paths = [{"value": f"/rbt_isr_{i}/odom.twist.twist.linear.x", "enabled": True} for i in range(members)]
    layout = {
        "configById": {
            "3D!scene": scene,
            "Plot!speeds": {"title": "Speed [m/s]", "paths": paths, "showLegend": True, "xAxisVal": "timestamp"},
        },
        "globalVariables": {},
        "layout": {"direction": "column", "first": "3D!scene", "second": "Plot!speeds", "splitPercentage": 72},
    }
    return json.dumps(layout, indent=1) + "\n"


def rviz(members: int, grid: bool, followed: str) -> str:
    """A configuration that shows the scene from above. YAML. Parameters as in `foxglove`."""
    displays = [
        _display("rviz_default_plugins/MarkerArray", topic) for topic in ("/road", "/vehicles", "/traffic", "/targets")
    ]
    displays += [_display("rviz_default_plugins/Map", "/map")] * grid
    displays += [
        _display("rviz_default_plugins/LaserScan", f"/scan{i}", "      Size (Pixels): 3\n      Style: Points\n")
        for i in range(members)
    ]
    return f"""Visualization Manager:
  Class: ""
  Displays:
{"".join(displays)}  Enabled: true
  Global Options:
    Background Color: 240; 240; 240
    Fixed Frame: map
    Frame Rate: 30
  Tools:
    - Class: rviz_default_plugins/MoveCamera
    - Class: rviz_default_plugins/Measure
  Views:
    Current:
      Class: rviz_default_plugins/TopDownOrtho
      Scale: 12
      Target Frame: {followed}
"""


def _display(kind: str, topic: str, more: str = "") -> str:
    durability = "Transient Local" if topic in LATCHED else "Volatile"
    return f"""    - Class: {kind}
      Enabled: true
      Name: {topic}
      Topic:
        Durability Policy: {durability}
        Value: {topic}
      Value: true
{more}"""
