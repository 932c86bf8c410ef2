#include "shdr_sink.hpp"

#include <chrono>
#include <cmath>
#include <utility>

#include "servosense/io/write_file.hpp"
#include "servosense/monitors/event_text.hpp"

namespace servosense::cli {
namespace {

constexpr Nanoseconds kInterval = kNanosecondsPerSecond / 10;

// Times of a bus are of the calendar already; those of most traces count from their beginning, and
// an agent is told when they are played.
Nanoseconds calendar(Nanoseconds t_ns) {
  constexpr Nanoseconds kYear2000 = 946'684'800 * kNanosecondsPerSecond;
  if (t_ns > kYear2000) return t_ns;
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

Expected<Done> ShdrSink::open(const Arguments& arguments, const StackPlan& plan,
                              const std::string& machine) {
  for (const Channel channel : kDriveChannels)
    if (plan.slot_of(channel) != nullptr) drives_.push_back({channel});
  if (const auto path = arguments.value("--shdr-device")) {
    MtconnectDevice device{machine, {}, {}};
    for (const Drive& drive : drives_) device.channels.push_back(drive.channel);
    for (const MonitorAvailability& m : plan.monitors)
      if (m.runs) device.monitors.emplace_back(name_of(m.monitor), name_of(m.channel));
    if (auto done = write_file(*path, device_file(device)); !done) return done.error();
  }
  const auto port = arguments.positive("--shdr");
  if (!port) return port.error();
  if (!*port) return Done{};
  if (**port > 65535 || **port != static_cast<std::uint16_t>(**port))
    return usage_error("--shdr takes a port 1 to 65535; MTConnect's own is 7878");
  ShdrConfig config;
  config.port = static_cast<std::uint16_t>(**port);
  if (const auto address = arguments.value("--shdr-address")) config.address = *address;
  auto server = ShdrServer::open(config);
  if (!server) return server.error();
  server_ = std::move(*server);
  server_->text(calendar(0), "avail", "AVAILABLE");
  for (const MonitorAvailability& m : plan.monitors)
    if (m.runs)
      server_->condition(calendar(0), condition_item(name_of(m.monitor), name_of(m.channel)),
                         "UNAVAILABLE", "", "has said nothing yet");
  return Done{};
}

void ShdrSink::event(Nanoseconds t_ns, const Event& event) {
  if (!server_) return;
  publish(*server_, calendar(t_ns), event);
  if (event.state != MonitorState::signal_fault || event.monitor != MonitorId::signal) return;
  // What was true before a fault is not known during it.
  const double unknown = std::nan("");
  const auto channel = channel_from(event.channel);
  if (!channel || !is_drive(*channel)) return;
  server_->value(calendar(t_ns), effort_item(*channel), unknown);
  if (is_turning(*channel)) server_->value(calendar(t_ns), speed_item(*channel), unknown);
}

void ShdrSink::sample(Nanoseconds t_ns, const MachineStack& stack) {
  if (!server_) return;
  if (!started_) next_ns_ = t_ns + kInterval;
  started_ = true;
  for (Drive& drive : drives_) {
    drive.effort += stack.drive(drive.channel).estimate;
    drive.travel += stack.drive(drive.channel).sample.increment;
  }
  ++count_;
  if (t_ns < next_ns_) return;
  const double n = static_cast<double>(count_);
  const double seconds = seconds_from(t_ns - next_ns_ + kInterval);
  const Nanoseconds now = calendar(t_ns);
  for (Drive& drive : drives_) {
    server_->value(now, effort_item(drive.channel), drive.effort / n);
    if (is_turning(drive.channel))
      server_->value(now, speed_item(drive.channel), rpm_from_rad_s(drive.travel / seconds));
    drive.effort = drive.travel = 0;
  }
  count_ = 0;
  next_ns_ = t_ns + kInterval;
}

}  // namespace servosense::cli
