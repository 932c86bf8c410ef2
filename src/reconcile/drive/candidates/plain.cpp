#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "reconcile/drive/candidates/kinds.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/model/cross_talk.hpp"

namespace servosense::reconcile {
namespace {

/// Candidate of one effect of the catalogue, driven by its own class.
class EffectCandidate {
 public:
  EffectCandidate(std::size_t effect, const DriveSituation& s)
      : effect_(effect),
        situation_(s),
        info_(kDriveEffects[effect]),
        traits_(kDriveEffectTraits[effect]) {
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      const EffectRole role = traits_.search[p].role;
      if (role == EffectRole::searched || role == EffectRole::scaled) searched_.push_back(p);
    }
  }

  [[nodiscard]] Candidate make() const {
    Candidate c;
    c.name = info_.name;
    c.scope = traits_.scope;
    c.where = traits_.where;
    c.splitting_motion = traits_.splitting_motion;
    c.sized = traits_.sized;
    for (const std::size_t p : searched_) c.search.push_back(range(traits_.search[p]));
    const EffectCandidate self = *this;
    c.columns = [self](std::span<const double> theta) { return self.columns(theta); };
    c.meaning = [self](std::span<const double> theta, std::span<const double> coefficients) {
      return self.meaning(theta, coefficients);
    };
    return c;
  }

 private:
  [[nodiscard]] bool turns() const { return situation_.data->turns(); }
  [[nodiscard]] const char* key(std::size_t p) const {
    return info_.parameters[p].key_for(turns());
  }

  [[nodiscard]] SearchRange range(const EffectSearch& s) const {
    // Of the model as given: shorter than that is the same friction seen by another law.
    const double presliding = situation_.data->model.friction_knee;
    double unit = 1;
    switch (s.in) {
      case EffectRange::absolute:
        break;
      case EffectRange::of_top_speed:
        unit = situation_.top_speed;
        break;
      case EffectRange::of_top_current:
        unit = situation_.top_current_A;
        break;
      case EffectRange::of_record:
        unit = situation_.duration_s;
        break;
      case EffectRange::of_knee:
        unit = presliding;
        break;
      case EffectRange::per_knee:
        unit = 1 / presliding;
        break;
      case EffectRange::of_band:
        unit = situation_.signals->corner_hz;
        break;
    }
    return {s.low * unit, s.high * unit, s.points};
  }

  /// Every parameter at its default, the searched ones at theta.
  [[nodiscard]] EffectSetting base(std::span<const double> theta) const {
    EffectSetting s;
    s.effect = effect_;
    for (std::size_t p = 0; p < info_.parameter_count(); ++p)
      if (!info_.parameters[p].optional) s.parameters[p].count = 1;
    for (std::size_t k = 0; k < searched_.size() && k < theta.size(); ++k)
      s.parameters[searched_[k]].value[0] = theta[k], s.parameters[searched_[k]].count = 1;
    return s;
  }
  [[nodiscard]] bool add_response(std::vector<Column>& to, const EffectSetting& s) const {
    // Friction and loads found meanwhile act, too: what depends on the load transmitted needs them.
    Column column = situation_.signals->response(s, situation_.acting);
    if (column.empty()) return false;
    to.push_back(std::move(column));
    return true;
  }

  /// The response to 1 of a parameter, from that to a value within its range.
  [[nodiscard]] bool add_scaled(std::vector<Column>& to, EffectSetting s, std::size_t p,
                                double value) const {
    s.parameters[p].value[0] = value;
    if (!add_response(to, s)) return false;
    for (double& v : to.back()) v /= value;
    return true;
  }

  [[nodiscard]] std::vector<Column> columns(std::span<const double> theta) const {
    std::vector<Column> out;
    EffectSetting s = base(theta);
    if (traits_.sized) return add_response(out, s) ? out : std::vector<Column>{};
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      EffectSetting unit = s;
      switch (traits_.search[p].role) {
        case EffectRole::linear:
          if (!add_scaled(out, unit, p, std::min(1.0, 0.5 * info_.parameters[p].high))) return {};
          break;
        case EffectRole::amplitude:
          for (const double phase : {0.0, kTwoPi / 4}) {
            for (std::size_t q = 0; q < info_.parameter_count(); ++q)
              if (traits_.search[q].role == EffectRole::phase) {
                unit.parameters[q].value[0] = phase;
                unit.parameters[q].count = 1;
              }
            if (!add_scaled(out, unit, p, std::min(1.0, 0.5 * info_.parameters[p].high))) return {};
          }
          break;
        case EffectRole::offset:
          if (!situation_.constant_known) out.emplace_back(situation_.signals->rows(), 1.0);
          break;
        default:
          break;
      }
    }
    return out;
  }

  [[nodiscard]] Meaning meaning(std::span<const double> theta,
                                std::span<const double> coefficients) const {
    Meaning m;
    const EffectSetting s = base(theta);
    std::array<double, kMaxEffectParameters> value{};
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) value[p] = s.parameters[p].value[0];
    std::size_t at = 0;
    double strength = 1;
    double cosine = 0, sine = 0;
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      const EffectRole role = traits_.search[p].role;
      if (role == EffectRole::linear && at < coefficients.size())
        value[p] = strength = coefficients[at++];
      else if (role == EffectRole::amplitude && at + 1 < coefficients.size()) {
        sine = coefficients[at++];
        cosine = coefficients[at++];
        value[p] = std::hypot(sine, cosine);
      } else if (role == EffectRole::offset && at < coefficients.size()) {
        value[p] = strength != 0 ? -coefficients[at++] / strength : 0;
      }
    }
    for (std::size_t p = 0; p < info_.parameter_count(); ++p) {
      const EffectRole role = traits_.search[p].role;
      if (role == EffectRole::scaled) value[p] *= std::abs(strength);
      if (role == EffectRole::phase) value[p] = std::atan2(cosine, sine);
      const EffectParameter& parameter = info_.parameters[p];
      if (parameter.optional && role == EffectRole::none) continue;
      if (!(value[p] >= parameter.low && value[p] <= parameter.high))
        m.violation = std::string(key(p)) + " would be " + printed(value[p], 3);
      m.parameters.push_back({key(p), {value[p]}, {}});
    }
    return m;
  }

  std::size_t effect_;
  DriveSituation situation_;
  EffectInfo info_;
  EffectTraits traits_;
  std::vector<std::size_t> searched_;
};

}  // namespace

Candidate effect_candidate(std::size_t effect, const DriveSituation& s) {
  return EffectCandidate(effect, s).make();
}

Candidate cross_talk_candidate(const DriveData::Other& other, const DriveSituation& s) {
  Candidate c;
  c.name = "cross-talk";
  c.where = "other-axis";
  c.splitting_motion = "each axis by itself, then both together";
  std::array<Column, kCrossTalkOf.size()> felt;
  const auto column_of = [&](CrossTalkOf of) -> Column& {
    return felt[static_cast<std::size_t>(of)];
  };
  if (!other.position.empty()) {
    const Column position = s.signals->to_work(other.position);
    column_of(CrossTalkOf::position) = s.signals->to_rows(position);
    column_of(CrossTalkOf::velocity) = s.signals->to_rows(position, 1);
    column_of(CrossTalkOf::acceleration) = s.signals->to_rows(position, 2);
  }
  if (!other.effort.empty())
    column_of(CrossTalkOf::effort) = s.signals->to_rows(s.signals->to_work(other.effort));
  // Which of them is a parameter without a way from one to the next.
  std::vector<std::vector<double>> starts;
  for (std::size_t k = 0; k < felt.size(); ++k)
    if (std::ranges::any_of(felt[k], [](double x) { return x != 0; }))
      starts.push_back({static_cast<double>(k)});
  if (starts.empty()) {
    c.not_testable = "no other axis moves";
    c.would_need = c.splitting_motion;
  }
  c.search = {{0, static_cast<double>(felt.size() - 1), 1, false}};
  c.starts = [starts](const Column&) { return starts; };
  const auto which = [](std::span<const double> theta) {
    return static_cast<std::size_t>(std::lround(theta[0]));
  };
  c.columns = [felt, which](std::span<const double> theta) {
    // Another record may lack it.
    const Column& column = felt[which(theta)];
    return column.empty() ? std::vector<Column>{} : std::vector<Column>{column};
  };
  const std::string channel(servosense::name_of(other.channel));
  c.meaning = [channel, which](std::span<const double> theta,
                               std::span<const double> coefficients) {
    Meaning m;
    m.parameters = {{"other_channel", {}, channel},
                    {"coefficient", {coefficients[0]}, {}},
                    {"of", {}, std::string(kCrossTalkOf[which(theta)])}};
    return m;
  };
  return c;
}

}  // namespace servosense::reconcile
