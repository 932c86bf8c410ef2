"""An MTConnect agent's view of the adapter: shdr_reader.py PORT DEVICE_FILE

Reads what the adapter says until it goes, line by line against the SHDR grammar of the MTConnect agent
(timestamp|item|value, conditions timestamp|item|level|native code|severity|qualifier|text), and the device
file against the rules of the standard that an agent depends on. Standard library only. Prints what is wrong,
then a line of counts; exit status 1 when something is.
"""
import re
import socket
import sys
import xml.etree.ElementTree as xml

SPACE = "{urn:mtconnect.org:MTConnectDevices:2.0}"
# Types and units of the standard (MTConnect part 2) that this adapter has a use for.
KNOWN = {
    ("EVENT", "AVAILABILITY", None),
    ("SAMPLE", "TORQUE", "NEWTON_METER"),
    ("SAMPLE", "ROTARY_VELOCITY", "REVOLUTION/MINUTE"),
    ("SAMPLE", "LINEAR_FORCE", "NEWTON"),
    ("CONDITION", "SYSTEM", None),
}
wrong = []


def complain(text):
    if len(wrong) < 20:
        print(text)
    wrong.append(text)


def device(path):
    """Data items by name: category."""
    root = xml.parse(path).getroot()
    if root.tag != SPACE + "MTConnectDevices":
        complain("the root is " + root.tag)
    header = root.find(SPACE + "Header")
    for name in ("creationTime", "sender", "instanceId", "version", "bufferSize"):
        if header is None or not header.get(name):
            complain("Header has no " + name)
    devices = root.find(SPACE + "Devices")
    if devices is None or len(devices) != 1 or not devices[0].get("uuid") or not devices[0].get("name"):
        complain("one Device with name and uuid is expected")
    ids = [e.get("id") for e in devices.iter() if e.get("id") is not None]
    for one in set(ids):
        if ids.count(one) > 1:
            complain("id " + one + " twice")
        if not re.fullmatch(r"[A-Za-z_][\w.-]*", one):
            complain("id " + one + " is no XML ID")
        # Files of many machines stand in one agent: their ids must not meet.
        if one != devices[0].get("id") and not one.startswith(devices[0].get("id") + "_"):
            complain("id " + one + " would be another machine's as well")
    for parent in devices.iter():
        if parent.tag.removeprefix(SPACE) in ("Device", "Axes", "Rotary", "Linear"):
            kinds = [child.tag.removeprefix(SPACE) for child in parent]
            if kinds != [k for k in ("Description", "DataItems", "Components") if k in kinds]:
                complain("children of %s: %s" % (parent.tag, kinds))
        if parent.tag in (SPACE + "DataItems", SPACE + "Components") and len(parent) == 0:
            complain("an empty list in the device file")
    items = {}
    for item in devices.iter(SPACE + "DataItem"):
        if item.get("name") in items:
            complain("data item %s twice" % item.get("name"))
        items[item.get("name")] = item.get("category")
        if (item.get("category"), item.get("type"), item.get("units")) not in KNOWN:
            complain("no such data item in the standard: %s" % item.attrib)
    return items


def line(text, items, seen):
    if text.startswith("* "):
        if not re.fullmatch(r"\* (shdrVersion: \d+(\.\d+)?|adapterVersion: .+|PONG \d+)", text):
            complain("no command of an adapter: " + text)
        seen.add(text.split()[1])
        return
    fields = text.split("|")
    if not re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d+Z", fields[0]):
        complain("no time: " + text)
    category = items.get(fields[1] if len(fields) > 1 else "")
    if category is None:
        complain("not in the device file: " + text)
        return
    seen.add(fields[1])
    if category == "CONDITION":
        if len(fields) != 7 or fields[2] not in ("NORMAL", "WARNING", "FAULT", "UNAVAILABLE"):
            complain("no condition: " + text)
    elif len(fields) != 3:
        complain("no value: " + text)
    elif category == "SAMPLE" and fields[2] != "UNAVAILABLE":
        if not re.fullmatch(r"-?\d+(\.\d+)?([eE][+-]?\d+)?", fields[2]):
            complain("no number: " + text)


def main():
    items = device(sys.argv[2])
    adapter = socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5)
    adapter.settimeout(30)
    adapter.sendall(b"* PING\n")
    lines, rest, seen = 0, b"", set()
    while data := adapter.recv(4096):
        *whole, rest = (rest + data).split(b"\n")
        for one in whole:
            line(one.decode("utf-8"), items, seen)
            lines += 1
    if rest:
        complain("broken off: " + repr(rest))
    for name in list(items) + ["PONG", "shdrVersion:"]:
        if name not in seen:
            complain("never said: " + name)
    print("%d lines, %d data items, %d wrong" % (lines, len(items), len(wrong)))
    return 1 if wrong else 0


sys.exit(main())
