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
  plan_ = plan;
  if (const auto path = arguments.value("--shdr-device")) {
    MtconnectDevice device{machine, {}, {}};
    auto add = [&](Channel channel) { device.channels.emplace_back(name_of(channel)); };
    if (plan.config.spindle.present) add(Channel::spindle);
    for (std::size_t i = 0; i < kAxes; ++i)
      if (plan.config.axis[i].present) add(axis_channel(i));
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
  if (event.channel == name_of(Channel::spindle)) {
    server_->value(calendar(t_ns), "spindle_torque", unknown);
    server_->value(calendar(t_ns), "spindle_speed", unknown);
  }
  for (std::size_t i = 0; i < kAxes; ++i)
    if (event.channel == name_of(axis_channel(i)))
      server_->value(calendar(t_ns), event.channel + "_force", unknown);
}

void ShdrSink::sample(Nanoseconds t_ns, const HostStack& stack) {
  if (!server_) return;
  const bool spindle = plan_.config.spindle.present;
  if (!started_) next_ns_ = t_ns + kInterval;
  started_ = true;
  if (spindle) {
    torque_ += stack.spindle().estimate;
    turned_ += stack.spindle().sample.increment;
  }
  for (std::size_t i = 0; i < kAxes; ++i)
    if (plan_.config.axis[i].present) force_[i] += stack.axis(i).estimate;
  ++count_;
  if (t_ns < next_ns_) return;
  const double n = static_cast<double>(count_);
  const double seconds = seconds_from(t_ns - next_ns_ + kInterval);
  const Nanoseconds now = calendar(t_ns);
  if (spindle) {
    server_->value(now, "spindle_torque", torque_ / n);
    server_->value(now, "spindle_speed", rpm_from_rad_s(turned_ / seconds));
  }
  for (std::size_t i = 0; i < kAxes; ++i)
    if (plan_.config.axis[i].present)
      server_->value(now, std::string(name_of(axis_channel(i))) + "_force", force_[i] / n);
  torque_ = turned_ = 0;
  force_ = {};
  count_ = 0;
  next_ns_ = t_ns + kInterval;
}

}  // namespace servosense::cli
