#include "reconcile/report/maintenance_advice.hpp"

#include <array>

namespace servosense::reconcile {
namespace {

constexpr auto kWords = std::to_array<MaintenanceAdvice>({
    {"viscous-friction", "friction that grows with speed is not in the model",
     "take it over; if it has grown since the last record, look at lubricant, seals and bearings"},
    {"coulomb-friction", "friction that is the same at every speed is not in the model",
     "take it over; if it has grown since the last record, look at wipers, preload and bearings"},
    {"stribeck-friction",
     "the drive needs more force to start and to creep than to move fast: it tends to stick and "
     "slip at low feed, and reversals leave marks",
     "check the lubrication of guides and screw; let the controller compensate friction at "
     "reversal"},
    {"asymmetric-friction", "the drive runs harder one way than the other",
     "look for a bent screw, a misaligned guide, a wiper or cable that drags one way, and the "
     "counterweight"},
    {"presliding-hysteresis",
     "the drive gives way like a spring for some micrometres before it slides: small moves and "
     "reversals arrive late",
     "usual for rolling guides; if it is new, check the preload of nut and bearings"},
    {"quadratic-drag", "resistance that grows with the square of the speed",
     "usual for fans, churned oil and grease; after new grease let it run in"},
    {"position-dependent-friction", "the drive runs harder at some places of its travel",
     "look there for chips, a damaged guide or screw, and a guide that is not straight"},
    {"thermal-friction-drift", "friction changes while the machine warms up",
     "warm up before work that must be exact, and learn thresholds on the warm machine"},
    {"thermal-viscous-drift", "friction that grows with speed changes while the machine warms up",
     "warm up before work that must be exact; if it lasts longer than usual, look at the bearings"},
    {"field-weakening", "the motor gives less torque per ampere above its base speed",
     "take it over; it is how such motors are built"},
    {"torque-saturation", "the motor gives less torque per ampere at high current",
     "take it over; if it is new, the magnets may have been hot"},
    {"torque-constant-temperature", "the motor gives less torque per ampere when it is warm",
     "take it over; it is how magnets are, but a motor that was too hot stays weak"},
    {"constant-load", "the drive carries a weight or a pull that the model does not know",
     "on a vertical axis check the counterweight or its pressure; else look for what pulls"},
    {"spring-load", "a force that grows along the travel",
     "look at cable chain, bellows and hoses: one of them pulls"},
    {"torque-ripple", "the force waves with every turn of motor or screw",
     "usual in small size; if it has grown look at coupling, bearings and motor"},
    {"backlash", "the drive loses motion: after a reversal the motor moves before the stage does",
     "check nut, preload, coupling and the axial bearing; let the controller compensate until "
     "then"},
    {"flexible-coupling", "the stage swings against the motor at the frequency given",
     "check coupling and belt; keep the gains of the controller below that frequency, or notch it"},
    {"transport-delay", "signals arrive later than the model says",
     "check the time at which the drive reports them; thresholds stay valid"},
    {"current-loop-lag", "the current follows its command more slowly than the model says",
     "check the tuning of the current loop"},
    {"encoder-eccentricity", "the encoder is not centred: its angle errs once a turn",
     "centre it, or let the drive compensate"},
    {"lead-error", "the screw does not travel what it should for its turns",
     "compensate it in the controller's table for the axis; if it has grown, the screw is worn"},
    {"runout", "the teeth do not run on one circle: some cut more than others",
     "clean and check holder and taper, set the inserts; the fullest tooth wears first"},
    {"missing-tooth", "a tooth cuts less than the others or not at all",
     "look at the tool: a tooth or an insert is broken, worn or set back"},
    {"edge-force", "the edges rub more than the model says: they are blunter",
     "look at the wear of the tool"},
    {"size-effect", "thin chips take more force for their area than thick ones",
     "take it over; a larger feed per tooth costs less power for the metal removed"},
    {"process-damping", "the flank rubs on the waves of the surface and calms the vibration",
     "take it over; at low speed deeper cuts are stable than the lobes say without it"},
    {"regeneration", "the cut remembers the waves of the tooth before: the way to chatter",
     "use the stability lobes to choose speed and depth"},
    {"extra-mode", "tool or machine swings at a frequency that the model lacks",
     "measure it with a hammer if it matters for chatter"},
    {"sensor-resonance", "the dynamometer swings itself and distorts the force",
     "compensate it, or cut at lower tooth passing frequencies"},
    {"helix-lag", "the helix of the tool is not the one in the file", "correct the tool's data"},
    {"pitch-error", "the teeth are not where the file has them", "correct the tool's data"},
    {"cross-talk", "the drive feels the motion of another axis",
     "usual where one axis carries another; if it is new check squareness and clamping"},
    {"load-dependent-friction", "friction grows with the force that is carried over",
     "usual for screws under load; if it has grown look at the nut"},
    {"time-locked-vibration", "something that does not turn with the machine shakes it",
     "look for pumps, fans and neighbours that run at that frequency"},
});

}  // namespace

MaintenanceAdvice maintenance_advice(std::string_view effect) {
  for (const MaintenanceAdvice& words : kWords)
    if (words.effect == effect) return words;
  return {};
}

}  // namespace servosense::reconcile
