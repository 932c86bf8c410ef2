// From the machine file to the simulators: [tool], [cut], [structure.*], [simulation],
// [controller.*], and the effects of tool and structure. Files that it names are found beside it.
#pragma once

#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/model/cross_talk.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/machine_simulator.hpp"
#include "servosense/sim/milling_simulator.hpp"

namespace servosense {

/// [tool], with the file of coefficients that it may name, and what [effect.*.runout],
/// .missing-tooth, .edge-force, .size-effect, .process-damping, .helix-lag and .pitch-error add to
/// it. Data error for what is missing (diameter, teeth, tangential coefficient) and for lists that
/// are not one number a tooth.
Expected<MillingTool> milling_tool(const MachineFile& machine);

/// The same without its coefficients: diameter_m, teeth, how they stand and what of them is gone.
Expected<MillingTool> milling_teeth(const MachineFile& machine);

/// [cut]. All keys are required, but radial_immersion_m only when the cut is no slot, and
/// regeneration, which is yes without it and with [effect.*.regeneration].
Expected<MillingCut> milling_cut(const MachineFile& machine);

/// The modes of [structure.x] and [structure.y] and of [effect.*.extra-mode], which acts in its
/// direction when its channel is x or y, else in both. A direction without modes is rigid. Data
/// error for a structure that is given by a receptance.
Expected<Structure> structure_modes(const MachineFile& machine);

/// Tool, cut, structure and [simulation]. `travel` and speed profile last for `duration_s`.
///
/// workpiece: parts between commas: `block [LENGTH]`, `triangle FRONT_DEPTH FAR_DEPTH [LENGTH]`,
/// `slot FROM TO`, `hole X Y RADIUS`, all in metres, x from the front face; or the name of a file
/// with such parts, one a line. A triangle without a length is as long as the feed in
/// `duration_s`.
/// spindle_speed_profile: `RATE %/s [of RPM] [from RPM] [to RPM]`, of, from and to being the speed
/// of the cut, and the end of the ramp that of the simulation, unless given; or a trace with
/// spindle.speed_rad_s.
Expected<MillingSimulation> milling_simulation(const MachineFile& machine, double duration_s);

/// One drive under its controller: [spindle] or [axis.*], [controller.*], [effect.*] and the seed
/// of [simulation]. A spindle runs in the velocity loop, an axis in the position loop. Data error
/// for a missing section, or a machine without inertia.
Expected<DriveSimulatorConfig> drive_simulation(const MachineFile& machine, Channel channel);

/// A cut of `cut_s` between the drives that the file has a [controller.*] for; the others are
/// ideal. Around it: run-up and run-down of the spindle at 2000 rad/s2, the feed at 1 m/s2 and 50
/// m/s3, 0.2 s between them.
Expected<MachineSimulation> machine_simulation(const MachineFile& machine, double cut_s);

/// [effect.<channel>.cross-talk], if there is one.
Expected<std::vector<CrossTalk>> cross_talk_of(const MachineFile& machine, Channel channel);

/// [machine] sample_rate_hz, 8000 when it is not given.
[[nodiscard]] double servo_rate_hz(const MachineFile& machine);

}  // namespace servosense
