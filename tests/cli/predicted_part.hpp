// A part of `detection/milled_passes.hpp` as the program gets it: machine file, NC program, and
// what `program predict` makes of both.
#pragma once

#include "detection/milled_passes.hpp"
#include "program.hpp"

namespace program_test {

/// Writes machine.ini, part.ngc and steps.csv, which the file names as the reference of its band.
inline servosense::MachineFile predict(const detection::passes::Part& p,
                                       servosense::MachineFile machine) {
  machine.set("monitor.torque-band", "reference", "steps.csv");
  put("machine.ini", machine.text());
  put("part.ngc", detection::passes::program_of(p));
  // That of the part before: the program does not write over what a machine file names.
  fs::remove(folder / "steps.csv");
  const Outcome o =
      run("program predict part.ngc --machine machine.ini --stock-tolerance 0.0002 --quiet --out "
          "steps.csv " +
          detection::passes::stock_of(p));
  that(o.status == 0, o, "is predicted", __LINE__);
  return machine;
}

}  // namespace program_test
