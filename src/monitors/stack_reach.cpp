#include "servosense/monitors/stack_reach.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "servosense/dsp/lag_gain.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense {
namespace {

// Two figures tell all there is to tell.
std::string rounded(double value) {
  char text[32];
  std::snprintf(text, sizeof text, value >= 10 ? "%.0f" : "%.2g", value);
  return text;
}

std::vector<double> modes_of(const MachineFile& machine) {
  std::vector<std::array<double, 3>> modes;
  for (const char* section : {"structure.x", "structure.y"})
    if (const auto found = machine.triples(section, "modes"))
      modes.insert(modes.end(), found->begin(), found->end());
  // What a mode of this frequency, damping ratio and mass gives way by, at its resonance.
  const auto compliance = [](const std::array<double, 3>& m) {
    return 1 / (m[0] * m[0] * m[1] * m[2]);
  };
  std::sort(modes.begin(), modes.end(),
            [&](const auto& a, const auto& b) { return compliance(a) > compliance(b); });
  std::vector<double> hz;
  for (const auto& mode : modes) hz.push_back(mode[0]);
  return hz;
}

/// What the drive's filter hides of a current.
std::string behind_filter(double filter_hz, unsigned teeth) {
  const double half = lag_half_hz(filter_hz);
  return " (beyond " + rounded(half) + " Hz the drive's current shows less than half" +
         (teeth > 0 ? ", tooth passing from " + rounded(60 * half / teeth) + " rpm on" : "") + ")";
}

std::string speeds(const ChatterReach::Result& r) {
  const double from = rpm_from_rad_s(r.slowest_rad_s), to = rpm_from_rad_s(r.fastest_rad_s);
  char text[48];
  if (to < 1.05 * from)
    std::snprintf(text, sizeof text, "%.0f rpm", to);
  else
    std::snprintf(text, sizeof text, "%.0f to %.0f rpm", from, to);
  return text;
}

}  // namespace

StackReach::Spindle::Spindle(const MachineFile& machine, Channel which) : channel(which) {
  const std::string_view section = section_of(which);
  is_ratio = machine.flag(section, "current_is_ratio").value_or(false);
  rated_power_W = machine.number(section, "rated_power_W").value_or(0);
  current_filter_hz = machine.number(section, "current_filter_hz").value_or(0);
  if (which == tool_spindle(machine))
    teeth = static_cast<unsigned>(machine.number("tool", "teeth").value_or(0));
  const std::string controller = "controller." + std::string(name_of(which));
  if (const auto limit = machine.number(controller, "current_limit_A"))
    most_torque_Nm =
        std::abs(*limit * machine.number(section, "torque_constant_Nm_per_A").value_or(0) *
                 machine.number(section, "gear_ratio").value_or(1));
}

StackReach::StackReach(const MachineFile& machine, const StackPlan& plan, double sample_period_s)
    : run_(plan.grouped ? in_groups(plan.config) : plan.config),
      spindle_(machine, plan.tool_spindle),
      other_(machine, other_spindle(plan.tool_spindle)) {
  for (const MonitorAvailability& m : plan.monitors) {
    if (!m.runs) continue;
    if (m.monitor == MonitorId::chatter) {
      // Lines of a slow record are nobody's of a stack, nor is what a sensor hears.
      if (is_sensor(m.channel) || !plan.stack_of(m.channel).spindle.chatter_on) continue;
      ChatterReachConfig c;
      c.sample_period_s = sample_period_s;
      c.grouped = plan.grouped;
      const HostStackConfig& own = plan.stack_of(m.channel);
      const HostSpindleSlotConfig slot = (plan.grouped ? in_groups(own) : own).spindle;
      c.observer = slot.monitor_observer;
      c.chatter = slot.chatter;
      c.current_update_hz = machine.number(section_of(m.channel), "current_update_hz").value_or(0);
      c.current_filter_hz = machine.number(section_of(m.channel), "current_filter_hz").value_or(0);
      if (m.channel == plan.tool_spindle) c.modes_hz = modes_of(machine);
      (m.channel == plan.tool_spindle ? spindle_ : other_).reach =
          std::make_unique<ChatterReach>(c);
    } else if (m.monitor == MonitorId::collision) {
      const std::size_t i = axis_index(m.channel);
      const double filter_hz =
          machine.number(section_of(m.channel), "current_filter_hz").value_or(0);
      axes_.push_back({i, CollisionReach(run_.axis[i], i, plan.grouped, filter_hz)});
      axis_is_ratio_[i] = machine.flag(section_of(m.channel), "current_is_ratio").value_or(false);
    }
  }
}

StackReach::~StackReach() = default;

void StackReach::heard(const ServoSample<double>& sample, const HostStack& stack) {
  hear_spindle(sample.spindle, stack, spindle_);
  hear_axes_and_tool(stack);
}

void StackReach::heard(const MachineServoSample& sample, const MachineStack& stack) {
  hear_spindle(sample.drive(spindle_.channel), stack.first(), spindle_);
  if (other_.reach)
    hear_spindle(sample.drive(other_.channel), stack.stack_of(other_.channel), other_);
  if (const auto* coefficients = stack.coefficients())
    smallest_change_ = coefficients->smallest_change_seen();
  hear_axes_and_tool(stack.first());
}

void StackReach::hear_spindle(const RawDriveSample<double>& raw, const HostStack& stack,
                              Spindle& spindle) {
  spindle.raised = spindle.raised || stack.chatter().state().alarms > 0;
  if (spindle.reach) spindle.reach->heard(raw, stack);
}

void StackReach::hear_axes_and_tool(const HostStack& stack) {
  tooth_raised_ = tooth_raised_ ||
                  stack.tool().tooth_breakage().core().alarm().state().state == MonitorState::alarm;
  for (Axis& axis : axes_) axis.reach.heard(stack);
  if (!run_.tool.tooth_breakage_on) return;
  const auto& pattern = stack.tool().tooth_breakage().core();
  if (pattern.state().signal != SignalState::good || pattern.state().usual <= teeth_.usual) return;
  teeth_ = {pattern.state().usual, pattern.smallest_loss()};
}

void StackReach::tell(StackPlan& plan) const {
  for (MonitorAvailability& m : plan.monitors) {
    if (!m.runs) continue;
    if (m.monitor == MonitorId::chatter) {
      if (!is_sensor(m.channel) && plan.stack_of(m.channel).spindle.chatter_on)
        tell_chatter(m, m.channel == plan.tool_spindle ? spindle_ : other_);
    } else if (m.monitor == MonitorId::collision)
      tell_collision(m);
    else if (m.monitor == MonitorId::tooth_breakage)
      tell_teeth(m);
    else
      tell_tool(m, plan);
    if (m.sees_from)
      m.reason = (m.sees_from->blind ? "" : "sees ") + m.sees_from->text + "; " + m.reason;
  }
}

void StackReach::tell_chatter(MonitorAvailability& m, const Spindle& spindle) const {
  const auto r = spindle.reach ? spindle.reach->result() : std::nullopt;
  if (!r) {
    m.reason =
        "has judged nothing: the spindle has not turned fast enough for long enough; " + m.reason;
    return;
  }
  SeesFrom s;
  s.value = r->amplitude_Nm;
  s.unit = spindle.is_ratio ? "ratio" : "Nm";
  s.frequency_hz = r->frequency_hz;
  s.in_cut = r->in_cut_Nm;
  s.unheard_mode_hz = r->unheard_mode_hz;
  const auto torque = [&](double value) { return rounded(value) + " " + s.unit; };
  // In the cut it has to be heard, where there is one.
  const double needed = r->in_cut_Nm.value_or(r->amplitude_Nm);
  const std::string at = "chatter at " + rounded(r->frequency_hz) + " Hz";
  const double rated_Nm = spindle.rated_power_W > 0 ? spindle.rated_power_W / r->fastest_rad_s : 0;
  std::string beyond;
  if (!std::isfinite(needed))
    beyond = "no torque is enough";
  else if (r->largest_cut_Nm && needed > *r->largest_cut_Nm)
    beyond = "the cuts of the record have " + torque(*r->largest_cut_Nm) + " at most";
  else if (spindle.most_torque_Nm > 0 && needed > spindle.most_torque_Nm)
    beyond = "the drive gives " + torque(spindle.most_torque_Nm) + " at most";
  else if (rated_Nm > 0 && needed > rated_Nm)
    beyond = "the spindle is rated for " + torque(rated_Nm) + " there";
  // What has alarmed was heard, whatever the cuts besides have been.
  s.blind = !beyond.empty() && !spindle.raised;
  if (s.blind) {
    s.text = "cannot see chatter here: at " + rounded(r->frequency_hz) + " Hz and " + speeds(*r) +
             (std::isfinite(needed) ? " it takes " + torque(needed) + ", and " : " ") + beyond;
  } else {
    s.text = at + " from " + torque(s.value) + " at " + speeds(*r);
    if (r->in_cut_Nm && needed > 1.1 * s.value) s.text += ", in the cut from " + torque(needed);
  }
  if (spindle.current_filter_hz > 0)
    s.text += behind_filter(spindle.current_filter_hz, spindle.teeth);
  if (r->unheard_mode_hz)
    s.text += " (the structure's " + rounded(*r->unheard_mode_hz) +
              " Hz are beyond what these signals show)";
  m.sees_from = s;
}

void StackReach::tell_collision(MonitorAvailability& m) const {
  const std::size_t index = axis_index(m.channel);
  for (const Axis& axis : axes_) {
    if (axis.index != index) continue;
    const auto r = axis.reach.result();
    if (!r) {
      m.reason = "has judged nothing: it was never armed; " + m.reason;
      return;
    }
    SeesFrom s;
    s.value = r->step_N;
    s.unit = axis_is_ratio_[index] ? "ratio" : is_turning(m.channel) ? "Nm" : "N";
    s.text = std::string("a contact that comes to ") + rounded(r->step_N) + " " + s.unit +
             " at once, or rises by " + rounded(r->rate_N_per_s) + " " + s.unit + "/s" +
             (r->moving ? "" : ", axis at rest");
    m.sees_from = s;
  }
}

void StackReach::tell_teeth(MonitorAvailability& m) const {
  const ToothBreakageConfig& c = run_.tool.tooth_breakage;
  // Below half of it no pattern counts, whatever it is.
  const double floor = 0.5 * c.noise * c.noise_factor;
  const bool cut = teeth_.usual >= floor;
  SeesFrom s;
  s.unit = c.torque ? (spindle_.is_ratio ? "ratio" : "Nm") : "N";
  s.value = cut ? teeth_.lost : floor;
  s.blind = cut && teeth_.lost > teeth_.usual && !tooth_raised_;
  const auto size = [&](double value) { return rounded(value) + " " + s.unit; };
  if (!cut)
    s.text = "a tooth that has more than " + size(floor) + " and loses it";
  else if (s.blind)
    s.text = "cannot see a broken tooth here: it would have to lose " + size(teeth_.lost) +
             ", and cuts " + size(teeth_.usual);
  else
    s.text = "a tooth that loses " + size(teeth_.lost) + " of its " + size(teeth_.usual) + " (" +
             rounded(100 * teeth_.lost / teeth_.usual) + " %)";
  m.sees_from = s;
}

void StackReach::tell_tool(MonitorAvailability& m, const StackPlan& plan) const {
  SeesFrom s;
  const std::string torque = spindle_.is_ratio ? "ratio" : "Nm";
  switch (m.monitor) {
    case MonitorId::ar_breakage:
      s.value = run_.tool.ar_breakage.share_threshold;
      s.unit = "of a tooth";
      s.text = "a tooth that loses " + rounded(100 * s.value) + " % of its torque";
      break;
    case MonitorId::drill_fracture:
      s.value = run_.tool.drill_fracture.threshold_N;
      s.unit = "N";
      s.text = "a force of " + rounded(s.value) + " N that turns with the drill";
      break;
    case MonitorId::wear: {
      const WearConfig& w = run_.tool.wear;
      const auto rule = [&](double value, const std::string& unit, const std::string& of) {
        if (!(value > 0) || !s.text.empty()) return;
        s.value = value;
        s.unit = unit;
        s.text = of + " " + rounded(value) +
                 (unit == "ratio" ? " times that of the first holes" : " " + unit);
      };
      rule(w.thrust_step_N, "N", "a thrust that steps by");
      rule(w.thrust_ratio, "ratio", "a thrust of");
      rule(w.thrust_limit_N, "N", "a thrust of");
      rule(w.torque_step_Nm, torque, "a torque that steps by");
      rule(w.torque_ratio, "ratio", "a torque of");
      rule(w.torque_limit_Nm, torque, "a torque of");
      if (w.specific_force_ratio > 0 && s.text.empty()) {
        s.value = w.specific_force_ratio;
        s.unit = "ratio";
        s.text = "a specific cutting force of " + rounded(s.value) + " times that of the new tool";
      }
      if (s.text.empty()) return;
      break;
    }
    case MonitorId::torque_band: {
      // Half of the points are held at least so closely.
      std::vector<double> above;
      for (const auto& point : plan.torque_band) above.push_back(point.upper_Nm - point.torque_Nm);
      if (above.empty()) return;
      const auto middle = above.begin() + static_cast<std::ptrdiff_t>(above.size() / 2);
      std::nth_element(above.begin(), middle, above.end());
      s.value = *middle;
      s.unit = torque;
      s.text = "a torque that is " + rounded(s.value) + " " + torque + " too high for longer";
      break;
    }
    case MonitorId::cutting_coefficients:
      if (!(smallest_change_ > 0)) return;
      s.value = smallest_change_;
      s.unit = "ratio";
      s.text = "a specific cutting force that changes by " + rounded(100 * s.value) + " %";
      break;
    default:
      return;
  }
  m.sees_from = s;
}

}  // namespace servosense
