#!/usr/bin/python3
"""The panel of LinuxCNC in motion.sh: runs the programs of list.txt one after the other and writes, of each, when every
line of it ended and when the motion ended, counted in servo periods from the first motion."""
import os
import subprocess
import sys
import time

import linuxcnc

PERIOD_S = 0.001
command, status = linuxcnc.command(), linuxcnc.stat()


def wait_idle(seconds=900):
    until = time.time() + seconds
    calm = 0
    while time.time() < until:
        status.poll()
        idle = status.interp_state == linuxcnc.INTERP_IDLE and status.inpos and status.queue == 0
        calm = calm + 1 if idle else 0
        if calm > 20:
            return
        time.sleep(0.01)
    sys.exit("a program does not end")


def sampling(on):
    subprocess.run(["halcmd", "setp", "sampler.0.enable", "1" if on else "0"], check=True)


def sampler_into(path):
    with open(path, "w") as out:
        return subprocess.Popen(["halsampler", "-t"], stdout=out, stderr=subprocess.DEVNULL)


def end(process):
    process.terminate()
    process.wait()


def start():
    command.state(linuxcnc.STATE_ESTOP_RESET)
    command.wait_complete()
    command.state(linuxcnc.STATE_ON)
    command.wait_complete()
    for joint in range(3):
        command.home(joint)
        command.wait_complete()
    time.sleep(0.5)


def record(program, name, feed_override):
    sampling(False)
    sampler = sampler_into(os.devnull)  # what the last program left
    time.sleep(0.3)
    end(sampler)
    command.mode(linuxcnc.MODE_MDI)
    command.wait_complete()
    for line in ("G21 G90 G17 G94 G49 G40 G80 G54 G64 M5", "G53 G0 X0 Y0 Z0"):
        command.mdi(line)
        command.wait_complete(60)
    wait_idle()
    command.feedrate(feed_override)
    command.mode(linuxcnc.MODE_AUTO)
    command.wait_complete()
    command.program_open(program)
    samples = "samples.txt"
    sampler = sampler_into(samples)
    sampling(True)
    time.sleep(0.3)
    command.auto(linuxcnc.AUTO_RUN, 0)
    time.sleep(0.5)
    wait_idle()
    time.sleep(0.5)
    sampling(False)
    time.sleep(0.3)
    end(sampler)
    reduce(samples, name)


def reduce(samples, name):
    """Rows `line,end_s`: a row where the line changes, the last one where the motion ends."""
    rows, count, lost = [], 0, 0
    before = first = last = tag = line_before = None
    with open(samples) as lines:
        for text in lines:
            fields = text.split()
            if fields == ["overrun"]:
                continue  # a gap in the ticks, too
            if len(fields) != 5:
                break  # where the sampler was ended
            tick, at, line = int(fields[0]), tuple(map(float, fields[1:4])), int(fields[4])
            if tag is not None and tick != tag + 1:
                if count > 100:
                    lost += 1
                before = first = None  # before it were samples of the last program
            tag, count = tick, count + 1
            if before is not None and at != before:
                if first is None:
                    first = tick - 1
                line = line or line_before  # 0 while the last cycle runs out
                if line != line_before and line_before is not None:
                    rows.append((line_before, tick - 1 - first))
                line_before = line
                last = tick
            before = at
    with open(name, "w") as out:
        if first is None or lost:
            return  # an empty file: motion.sh says so
        out.write("line,end_s\n")
        for line, ticks in rows:
            out.write("%d,%.3f\n" % (line, ticks * PERIOD_S))
        out.write("%d,%.3f\n" % (line_before, (last - first) * PERIOD_S))


start()
with open("list.txt") as programs:
    for entry in programs:
        program, name, override = entry.split()
        record(program, name, float(override))
        print("recorded", name, flush=True)
