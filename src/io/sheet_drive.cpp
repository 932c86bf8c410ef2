#include "sheet_drive.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "servosense/core/units.hpp"
#include "servosense/io/sheet_figures.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr double kCountsAgreement = 1e-3;  // counts are exact, resolutions are printed rounded

/// What a figure is good for, where it was good for nothing.
std::string_view belongs_with(std::string_view figure) {
  if (figure == "motor_inertia" || figure == "load_inertia" || figure == "screw_inertia" ||
      figure == "table_mass")
    return "an equivalent mass takes lead_m, table_mass and motor_inertia, an inertia "
           "motor_inertia, "
           "and neither may be given";
  if (figure == "encoder_resolution") return "counts of a linear encoder take lead_m";
  return "a torque constant takes rated_torque (or rated_power and rated_speed) and rated_current";
}

class DriveSheet {
 public:
  DriveSheet(const std::string& section, const GivenFigures& figures)
      : section_(section), given_(figures), reported_(reported_amplitude(figures)) {}

  DerivedDrive derive() {
    const bool linear = drive_kind(section_) == DriveKind::linear;
    if (given("reported_current") != nullptr) used_.insert("reported_current");
    linear ? travel() : turning_encoder();
    torque_constant(linear);
    linear ? equivalent_mass() : inertia();
    rated_power();
    if (linear) table();
    for (const auto& [name, figure] : given_)
      if (find_machine_key(section_, name) == nullptr && !used_.contains(name))
        out_.remarks.push_back(section_ + "." + name +
                               " is not used: " + std::string(belongs_with(name)));
    return std::move(out_);
  }

 private:
  const GivenFigure* given(std::string_view name) const {
    const auto at = given_.find(name);
    return at == given_.end() ? nullptr : &at->second;
  }
  /// The value of a figure that is used with it; nothing if it is not given.
  std::optional<double> use(std::string_view name) {
    const GivenFigure* const figure = given(name);
    if (figure == nullptr) return std::nullopt;
    used_.insert(std::string(name));
    return figure->value;
  }
  /// "rated_torque 2.3 Nm"
  std::string said(std::string_view name) const {
    return std::string(name) + " " + given(name)->said;
  }
  void set(const char* key, double value, std::string from) {
    out_.keys.push_back({key, value, std::move(from)});
  }
  /// The key where it stands twice, given and worked out.
  void hold_together(const std::string& a, double value, const std::string& b, double other,
                     double agreement = kSheetAgreement) {
    if (std::abs(value / other - 1) <= agreement) return;
    out_.faults.push_back(section_ + ": " + a + " is " + printed(value) + ", but " + b + " gives " +
                          printed(other) + "; check both, or leave one out");
  }
  double gear() { return use("gear_ratio").value_or(1); }
  std::string with_gear() {
    return given("gear_ratio") != nullptr ? ", gear_ratio " + given("gear_ratio")->said : "";
  }

  /// Travel per turn of the motor, and counts of a scale beside the table.
  void travel() {
    const GivenFigure* const lead = given("lead_m");
    if (lead == nullptr) return;
    lead_m_ = lead->value;
    *lead_m_ /= gear();
    if (given("encoder_resolution") == nullptr) return;
    counts(*lead_m_ / *use("encoder_resolution"),
           "lead" + with_gear() + " over " + said("encoder_resolution"));
  }

  void turning_encoder() {
    if (given("encoder_resolution") != nullptr)
      counts(kTwoPi / *use("encoder_resolution"), "a turn over " + said("encoder_resolution"));
  }

  void counts(double value, const std::string& from) {
    if (const GivenFigure* const stated = given("encoder_counts_per_rev"))
      hold_together("encoder_counts_per_rev", stated->value, from, value, kCountsAgreement);
    else
      set("encoder_counts_per_rev", value, from);
  }

  /// Of the motor; nothing if the sheet does not tell it.
  struct Constant {
    double value;
    std::string from;
    Amplitude amplitude;
  };
  std::vector<Constant> motor_constants() {
    std::vector<Constant> all;
    if (const auto volts = use("voltage_constant")) {
      // Power of three phases: 3 E I = T w, with E the voltage between phases over the root of
      // three.
      const Amplitude told = given("voltage_constant")->amplitude;
      const double effective = *volts * (told == Amplitude::peak ? 1 / std::numbers::sqrt2 : 1);
      all.push_back({std::numbers::sqrt3 * effective, "root of 3 times " + said("voltage_constant"),
                     Amplitude::effective});
    }
    const auto torque = rated_torque();
    if (torque && given("rated_current") != nullptr) {
      Amplitude told = given("rated_current")->amplitude;
      if (told == Amplitude::unsaid) told = Amplitude::effective;  // as data sheets have it
      all.push_back({torque->value / *use("rated_current"),
                     torque->from + " over " + said("rated_current"), told});
    }
    for (Constant& c : all) c.value *= amplitude_factor(c.amplitude, reported_, -1);
    return all;
  }

  std::optional<DerivedKey> rated_torque() {
    const char* const power_name =
        given("rated_power") != nullptr ? "rated_power" : "rated_power_W";
    const bool by_power = given(power_name) != nullptr && given("rated_speed") != nullptr;
    std::optional<DerivedKey> by_speed;
    if (by_power)
      by_speed = {"", *use(power_name) / rad_s_from_rpm(*use("rated_speed")),
                  "(" + said(power_name) + " over " + said("rated_speed") + ")"};
    const auto torque = use("rated_torque");
    if (torque && by_speed)
      hold_together("rated_torque", *torque, power_name + std::string(" over rated_speed"),
                    by_speed->value);
    if (torque) return DerivedKey{"", *torque, said("rated_torque")};
    return by_speed;
  }

  void torque_constant(bool linear) {
    const char* const key = "torque_constant_Nm_per_A";
    const std::vector<Constant> constants = motor_constants();
    for (std::size_t i = 1; i < constants.size(); ++i)
      hold_together(constants[0].from, constants[0].value, constants[i].from, constants[i].value);
    if (const GivenFigure* const stated = given(key)) {
      const double value = stated->value * amplitude_factor(stated->amplitude, reported_, -1);
      for (const Constant& c : constants) hold_together(key, value, c.from, c.value);
      return;
    }
    if (constants.empty()) return;
    if (const GivenFigure* const force = given("force_constant_N_per_A"); linear && force) {
      const double value = force->value * amplitude_factor(force->amplitude, reported_, -1);
      if (lead_m_)
        for (const Constant& c : constants)
          hold_together("force_constant_N_per_A", value, c.from + " over the lead",
                        c.value / m_per_rad(*lead_m_));
      return;
    }
    if (linear && !lead_m_) {
      out_.remarks.push_back(section_ + ": a torque constant follows from " + constants[0].from +
                             ", but is of no use without lead_m");
      return;
    }
    const Constant& first = constants[0];
    set(key, first.value, first.from);
    if (first.from.find("rated_current") != std::string::npos)
      out_.remarks.push_back(section_ + "." + key +
                             " is that of the rated point: losses make it some per cent too small, "
                             "and of an induction "
                             "motor it holds below the rated speed only");
    if (reported_ == Amplitude::unsaid && first.amplitude != Amplitude::unsaid)
      out_.remarks.push_back(amplitude_remark(section_, key, first.amplitude));
  }

  void equivalent_mass() {
    const bool whole = given("table_mass") != nullptr || given("moving_mass_kg") != nullptr;
    if (!lead_m_ || !whole || given("motor_inertia") == nullptr) return;
    const char* const table = given("table_mass") != nullptr ? "table_mass" : "moving_mass_kg";
    const double ratio = gear();
    const double turning =
        *use("motor_inertia") + use("screw_inertia").value_or(0) / (ratio * ratio);
    const double reach = m_per_rad(*lead_m_);
    const double mass = *use(table) + turning / (reach * reach);
    std::string from = said(table) + ", " + said("motor_inertia");
    if (given("screw_inertia") != nullptr) from += ", " + said("screw_inertia");
    from += ", lead " + given("lead_m")->said + with_gear();
    if (const GivenFigure* const stated = given("equivalent_mass_kg")) {
      hold_together("equivalent_mass_kg", stated->value, from, mass);
      return;
    }
    set("equivalent_mass_kg", mass, from);
    if (given("screw_inertia") == nullptr)
      out_.remarks.push_back(section_ +
                             ".equivalent_mass_kg is without the screw, whose "
                             "screw_inertia is not given");
  }

  void inertia() {
    if (given("motor_inertia") == nullptr) return;
    const double ratio = gear();
    const double all = *use("motor_inertia") * ratio * ratio + use("load_inertia").value_or(0);
    std::string from = said("motor_inertia") + with_gear();
    if (given("load_inertia") != nullptr) from += ", " + said("load_inertia");
    if (const GivenFigure* const stated = given("inertia_kg_m2")) {
      hold_together("inertia_kg_m2", stated->value, from, all);
      return;
    }
    set("inertia_kg_m2", all, from);
    if (given("load_inertia") == nullptr)
      out_.remarks.push_back(
          section_ + ".inertia_kg_m2 is that of the motor alone: load_inertia is not given");
  }

  void rated_power() {
    const char* const key = "rated_power_W";
    if (find_machine_key(section_, key) == nullptr) return;
    const GivenFigure* const stated = given(key);
    if (const GivenFigure* const power = given("rated_power")) {
      use("rated_power");
      if (stated != nullptr)
        hold_together(key, stated->value, "rated_power", power->value);
      else
        set(key, power->value, said("rated_power"));
    } else if (stated == nullptr && given("rated_torque") != nullptr &&
               given("rated_speed") != nullptr) {
      set(key, *use("rated_torque") * rad_s_from_rpm(*use("rated_speed")),
          said("rated_torque") + " times " + said("rated_speed"));
    }
  }

  /// What gravity pulls at, unless a counterweight takes part of it off.
  void table() {
    if (given("table_mass") == nullptr || given("moving_mass_kg") != nullptr) return;
    set("moving_mass_kg", *use("table_mass"), said("table_mass"));
  }

  const std::string& section_;
  const GivenFigures& given_;
  Amplitude reported_;
  std::optional<double> lead_m_;  // per turn of the motor
  std::set<std::string, std::less<>> used_;
  DerivedDrive out_;
};

}  // namespace

double amplitude_factor(Amplitude given, Amplitude reported, int power) {
  if (given == reported || given == Amplitude::unsaid || reported == Amplitude::unsaid) return 1;
  return std::pow(std::numbers::sqrt2, given == Amplitude::effective ? power : -power);
}

Amplitude reported_amplitude(const GivenFigures& given) {
  const auto at = given.find("reported_current");
  if (at == given.end()) return Amplitude::unsaid;
  return at->second.written == "peak" ? Amplitude::peak : Amplitude::effective;
}

std::string amplitude_remark(const std::string& section, std::string_view key,
                             Amplitude amplitude) {
  const bool peak = amplitude == Amplitude::peak;
  return section + "." + std::string(key) + " is for " + (peak ? "peak" : "effective (rms)") +
         " amperes, which a trace is assumed to tell; if it tells " +
         (peak ? "effective values" : "peak values") +
         ", give reported_current=" + (peak ? "rms" : "peak") + " for the drive";
}

DerivedDrive derive_drive(const std::string& section, const GivenFigures& given) {
  return DriveSheet(section, given).derive();
}

}  // namespace servosense
