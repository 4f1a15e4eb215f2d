#include "netem/link/link_stages.hpp"

namespace tether {
namespace {

/// A stage of `make(stream)` that is on from packet `offered` on.
template <class Stage, class Make>
void switch_stage(std::optional<Stage>& stage, bool on, std::int64_t offered, Make make) {
  if (!on) {
    stage.reset();
  } else if (!stage) {
    stage.emplace(make());
    stage->skip(offered);
  }
}

}  // namespace

LinkStages::LinkStages(const LinkConfig& settings, const LinkStreams& streams,
                       const std::vector<double>& delay_table_ms)
    : config(settings), outages(settings.outages), state_loss_(streams("loss")) {
  switch_on(streams, 0);
  set_jitter(streams, delay_table_ms, 0, true);
}

LinkStages LinkStages::renewed(const LinkConfig& settings, const LinkStreams& streams,
                               const std::vector<double>& delay_table_ms,
                               std::int64_t offered) const {
  LinkStages next = *this;
  next.config = settings;
  next.outages = OutageSchedule(settings.outages);
  if (next.loss_) next.loss_->set(settings.loss);
  if (next.corruption) next.corruption->set(settings.corrupt);
  if (next.duplication_) next.duplication_->set(settings.duplicate_probability);
  if (next.rate) next.rate->set(settings.rate);
  if (next.reordering_) next.reordering_->set(settings.reorder);
  if (settings.slot != config.slot) next.slots.reset();
  next.switch_on(streams, offered);
  next.set_jitter(streams, delay_table_ms, offered, settings.jitter != config.jitter);
  return next;
}

void LinkStages::switch_on(const LinkStreams& streams, std::int64_t offered) {
  switch_stage(loss_, config.loss > 0.0, offered,
               [&] { return Coin(config.loss, streams("random_loss")); });
  switch_stage(corruption, config.corrupt.probability > 0.0, offered,
               [&] { return Corruption(config.corrupt, streams("corrupt")); });
  switch_stage(duplication_, config.duplicate_probability > 0.0, offered,
               [&] { return Coin(config.duplicate_probability, streams("duplicate")); });
  switch_stage(reordering_, config.reorder.probability > 0.0, offered,
               [&] { return Reordering(config.reorder, streams("reorder")); });
  if (config.rate.bits_per_s <= 0.0) {
    rate.reset();
  } else if (!rate) {
    rate.emplace(config.rate);
  }
  if (config.slot.period_ms <= 0.0) {
    slots.reset();
  } else if (!slots) {
    slots.emplace(config.slot, streams("slot"));
  }
}

void LinkStages::set_jitter(const LinkStreams& streams, const std::vector<double>& delay_table_ms,
                            std::int64_t offered, bool law_is_new) {
  const bool on = config.jitter.law != JitterConfig::Law::none;
  std::optional<DelayLaw> law;
  if (on && law_is_new) {
    law.emplace(config.jitter, delay_table_ms);
  } else if (on) {
    law = jitter_->law();
  }
  const double correlation = config.jitter.correlation;
  if (on && law_is_new && jitter_) jitter_->set(*law, correlation);
  if (on && law_is_new && copy_jitter_) copy_jitter_->set(*law, correlation);
  switch_stage(jitter_, on, offered,
               [&] { return DelaySequence(*law, correlation, streams("delay")); });
  switch_stage(copy_jitter_, on && config.duplicate_probability > 0.0, offered,
               [&] { return DelaySequence(*law, correlation, streams("copy_delay")); });
}

LinkStages::Luck LinkStages::draw(double prr) {
  Luck luck;
  luck.lost = uniform_01(state_loss_) >= prr;
  if (loss_ && loss_->toss()) luck.lost = true;
  if (corruption) luck.damage = corruption->next();
  if (duplication_) luck.duplicate = duplication_->toss();
  if (jitter_) luck.jitter = jitter_->next();
  if (copy_jitter_) luck.copy_jitter = copy_jitter_->next();
  if (reordering_) luck.skips_delay = reordering_->skips_delay();
  return luck;
}

}  // namespace tether
