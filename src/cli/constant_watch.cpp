#include "constant_watch.hpp"

#include <cmath>
#include <cstdio>

namespace servosense::cli {
namespace {

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%+.2g %%", 100 * share);
  return text;
}

std::string size_of(const ConstantDrift& d) {
  char text[64];
  std::snprintf(text, sizeof text, "%+.2g +- %.1g %%", 100 * d.drift, 100 * d.standard_error);
  return text;
}

std::string seen(Channel channel, const ConstantDrift& d) {
  return std::string(name_of(channel)) + ": effort per acceleration is " + size_of(d) +
         " off the machine file, by the last " + std::to_string(d.pairs) +
         " pairs of acceleration and braking";
}

}  // namespace

ConstantWatch::ConstantWatch(const MachineFile& machine, const StackPlan& plan) {
  if (plan.grouped || !machine.flag("monitor.signal", "enabled").value_or(true)) return;
  for (const Channel channel : kDriveChannels)
    if (const HostDriveSlotConfig* slot = plan.slot_of(channel))
      if (slot->observer.drive.inertia > 0)
        drives_.push_back({channel, ConstantCheck(slot->observer)});
}

std::vector<ConstantWatch::Change> ConstantWatch::sample(double t_s, const MachineStack& stack,
                                                         const KnownTorque& known) {
  std::vector<Change> changes;
  for (Drive& drive : drives_) {
    drive.check.sample(stack.drive(drive.channel).sample, known.known(drive.channel));
    if (drive.told || drive.check.pairs() == drive.heard) continue;
    drive.heard = drive.check.pairs();
    const auto drift = drive.check.now();
    if (!drift || !drift->beyond || drift->step) continue;
    drive.told = true;
    StateChange<double> change;
    change.monitor = MonitorId::signal;
    change.channel = drive.channel;
    change.state = MonitorState::warning;
    change.before = MonitorState::armed;
    change.value = drift->drift;
    change.threshold = ConstantCheck::kLeast;
    const bool turns = is_turning(drive.channel);
    Event event{t_s,
                change.monitor,
                std::string(name_of(drive.channel)),
                change.state,
                change.value,
                change.threshold,
                "1",
                seen(drive.channel, *drift) + ": the torque constant has changed, or the " +
                    (turns ? "inertia (another tool or work is clamped)"
                           : "mass (another work is clamped)") +
                    "; friction is told apart",
                {}};
    changes.push_back({change, std::move(event)});
  }
  return changes;
}

std::vector<ConstantWatch::Finding> ConstantWatch::findings() const {
  std::vector<Finding> all;
  for (const Drive& drive : drives_)
    if (const auto drift = drive.check.now()) all.push_back({drive.channel, *drift});
  return all;
}

std::vector<std::string> ConstantWatch::remarks() const {
  std::vector<std::string> all;
  for (const Finding& f : findings()) {
    if (!f.drift.step) continue;
    all.push_back(seen(f.channel, f.drift) + "; it stepped there from " + percent(f.drift.before) +
                  " across a standstill: another tool or work was clamped, no motor does that");
  }
  return all;
}

}  // namespace servosense::cli
