// SPDX-License-Identifier: Apache-2.0
// A photo of a step belongs to one rank, which draws it:
//
//   each rank     projects its rows for all photos, into the rooms of the photos' ranks
//   photo's rank  sorts, blends, compares, blends backward, one of its photos after another
//   each rank     pulls the gradients of its rows back, from the rooms of the photos' ranks, and
//                 updates its rows
//
// Within a process kernels read and write the memory of other GPUs, so that nothing is packed, sent
// and unpacked. Between processes a rank projects into a room of its own, and its rows of that are
// sent (photo_exchange.cuh). Splats lie in the order of the whole model, and every sum is that of
// one GPU: with RenderSettings::deterministic the model has the same bytes for any number of ranks.
#include "cuda/ranks/rank_steps.cuh"

#include <utility>

namespace gs::cuda {
namespace {

constexpr std::chrono::milliseconds kBetweenWatches{10};

// A rank whose photo did not fit halts all.
__global__ void halt_kernel(std::uint32_t* mine, const std::uint32_t* of_photo) {
  if (*of_photo) *mine = 1;
}

void halt_by(Rank& rank, Rank& other) {
  rank.context.launch("halt", halt_kernel, 1, 1, rank.halted(), other.halted());
}

}  // namespace

RankSteps::RankSteps(const std::vector<int>& devices)
    : first_(0), count_(int(devices.size())), steps_(*this) {
  connect(devices);
  for (const int device : devices) {
    const OnDevice here(device);
    ranks_.push_back(std::make_unique<Rank>(device, streams_));
    rooms_.push_back(&ranks_.back()->room);
  }
  const OnDevice here(device());
  photometric_ = std::make_unique<PhotometricStage>(context(), memory());
}

RankSteps::RankSteps(int device, int rank, int count)
    : first_(rank), count_(count), steps_(*this, Launchers::many) {
  ranks_.push_back(std::make_unique<Rank>(device, streams_));
  for (int r = 0; r < count; ++r) {
    if (r != rank) rooms_of_others_.push_back(std::make_unique<PhotoRoom>(context(), memory()));
    rooms_.push_back(r == rank ? &ranks_.front()->room : rooms_of_others_.back().get());
  }
  exchange_ = std::make_unique<PhotoExchange>(context(), memory(), rank, count);
  photometric_ = std::make_unique<PhotometricStage>(context(), memory(), true);
}

RankSteps::~RankSteps() {
  streams_.wait();
  streams_.forget();
}

void RankSteps::use_link(DeviceLink& link, std::function<void()> keep_watch) {
  link_ = &link;
  watch_ = std::move(keep_watch);
  context().watch_by([this] { this->keep_watch(); });
}

void RankSteps::use_photometric(const PhotometricModel* photometric, const std::string& device) {
  photometric_->use(photometric, device);
}

void RankSteps::upload_views(const std::vector<View>& views, std::size_t photo_bytes) {
  for (const std::unique_ptr<Rank>& rank : ranks_) {
    const OnDevice here(rank->context.device());
    rank->photos.upload_views(views, photo_bytes);
  }
  steps_.forecast().forget();
}

void RankSteps::deal(const TrainingModel& model, const Deal& deal) {
  deal_ = deal;
  if (!exchange_) return deal_out(model, deal_, ranks_);
  const OnDevice here(device());
  take_place(model, deal_, first_, *ranks_.front());
  deal_to_processes(*ranks_.front(), deal_, first_, &model, *link_);
}

void RankSteps::take_deal(const TrainingModel& shape, const Deal& deal) {
  GS_CHECK(exchange_);
  deal_ = deal;
  const OnDevice here(device());
  take_place(shape, deal_, first_, *ranks_.front());
  shard().photometric = copy_to(memory(), shape.photometric);
  deal_to_processes(*ranks_.front(), deal_, first_, nullptr, *link_);
}

void RankSteps::gather(const TrainingModel& model) {
  if (!exchange_)
    merge(ranks_, deal_, model);
  else
    gather_from_processes(*ranks_.front(), deal_, first_, &model, *link_);
}

void RankSteps::give_rows() {
  gather_from_processes(*ranks_.front(), deal_, first_, nullptr, *link_);
}

void RankSteps::launch(TrainingModel& model, const StepOrder& order) {
  model_ = &model;
  const Span<const TrainingPhoto> batch{order.photos.data(), order.photos.size()};
  RankedStep step(model, batch, order.loss, order.update, order.density);
  const PhotometricUpdate photometric = step.photometric =
      photometric_->update_of(model.photometric, order.update);
  steps_.launch(std::move(step), deal_.rows);
  if (photometric.is_due) model.photometric.adam_steps += photometric.rule.steps;
  model.adam_steps += order.update.rule.steps;
  last_drawer_ = int((batch.size - 1) % std::size_t(count_));
}

void RankSteps::release_caches(bool shards_are_in_use) {
  for (const std::unique_ptr<Rank>& rank : ranks_) {
    const OnDevice here(rank->context.device());
    rank->release_caches();
    if (!shards_are_in_use) rank->shard = TrainingModel(rank->memory);
  }
  for (const std::unique_ptr<PhotoRoom>& room : rooms_of_others_) room->release_caches();
  if (exchange_) exchange_->release();
  photometric_->release_caches();
}

// No rank begins an update before all memory for the step was found.
void RankSteps::enqueue(const RankedStep& step) {
  {
    const OnDevice here(device());
    photometric_->begin(model_->photometric, step.batch.size());
  }
  if (step.density.fragment_statistic() != FragmentStatistic::none)
    for (const std::unique_ptr<Rank>& rank : ranks_) begin_sums(rank->shard);
  run(step);
  update_looks(step);
  if (!(step.density.noise.scale > 0)) return;
  for (const std::unique_ptr<Rank>& rank : ranks_) {
    const OnDevice here(rank->context.device());
    add_position_noise(rank->context, rank->shard.gaussians.span(), step.density.noise,
                       step.position_rate, rank->halted(), rank->place);
  }
}

// The numbers of the photometric model are on the first GPU of this process, which knows by now
// that all photos are drawn. Those that draw the next ones read them there. Processes have a copy
// each, and all copies change alike.
void RankSteps::update_looks(const RankedStep& step) {
  Rank& first = *ranks_.front();
  const OnDevice here(first.context.device());
  photometric_->update(model_->photometric, step.photometric, step.photos(), first.halted());
  if (step.photometric.is_due) first.has_pulled_back.set();
}

// The ranks project their rows for all photos, then each draws its photos, and then they update
// their rows by all of them.
void RankSteps::run(const RankedStep& step) {
  const std::size_t count = std::size_t(count_);
  std::vector<DrawnPhoto> batch;
  std::vector<PhotoRows> photos;
  for (std::size_t i = 0; i < step.batch.size(); ++i) {
    batch.push_back(drawn_photo(step, i));
    const DrawnPhoto& drawn = batch.back();
    PhotoRoom& room = drawn.room;
    const OnDevice here(drawn.rank ? drawn.rank->context.device() : device());
    steps_.reports().clear(drawn.number);
    photos.push_back(room.photo_buffers.rows(i / count, drawn.camera, drawn.settings, nullptr,
                                             deal_.rows, room.renderer, room.pass,
                                             drawn.rank != nullptr));
    if (i < count && drawn.rank) drawn.rank->photos.prefetch_next(*drawn.photo.view);
  }
  const Span<const PhotoRows> all{photos.data(), photos.size()};
  for (const std::unique_ptr<Rank>& rank : ranks_) {
    const OnDevice here(rank->context.device());
    wait_for_others(*rank);
    preprocess(rank->context, rank->shard.gaussians.span(), all, rank->place);
    rank->has_projected.set();
  }
  std::vector<PhotoUnderWay> sent;
  if (exchange_) {
    sent = under_way(step, batch, photos);
    exchange_->send_splats(deal_, sent, *link_);
  }
  for (std::size_t i = 0; i < batch.size(); ++i) {
    if (!batch[i].rank) continue;
    Rank& rank = *batch[i].rank;
    PhotoRoom& room = batch[i].room;
    const OnDevice here(rank.context.device());
    if (i + count < batch.size()) rank.photos.prefetch_next(*batch[i + count].photo.view);
    room.photo_buffers.select(i / count, photos[i], deal_.rows, room.renderer, room.pass);
    draw(step, batch[i]);
  }
  if (exchange_) exchange_->send_gradients(deal_, sent, ranks_.front()->halted(), *link_);
  for (const std::unique_ptr<Rank>& rank : ranks_) update(step, *rank, all);
}

// A rank's rows, once all ranks have drawn. Where a photo did not fit, nothing changes.
void RankSteps::update(const RankedStep& step, Rank& rank, Span<const PhotoRows> photos) {
  const OnDevice here(rank.context.device());
  for (const std::unique_ptr<Rank>& other : ranks_) {
    other->has_drawn.hold_back(rank.context);
    if (other.get() != &rank) halt_by(rank, *other);
  }
  for (const PhotoRows& photo : photos)
    if (photo.settings.fragment_statistic != FragmentStatistic::none)
      gather_fragment_sums(rank.context, photo, rank.shard.statistics.sums.span(), rank.halted(),
                           rank.place);
  update_by_photos(rank.context, rank.shard, photos, step, rank.halted(), rank.place);
  rank.has_pulled_back.set();
}

RankSteps::DrawnPhoto RankSteps::drawn_photo(const RankedStep& step, std::size_t index) {
  const TrainingPhoto& photo = step.batch[index];
  RenderSettings settings = photo.settings;
  settings.fragment_statistic = step.density.fragment_statistic();
  settings.with_depths = false;
  const int drawer = int(index % std::size_t(count_));
  return {photo,    index,  step.number_of(index),        reduced(photo.camera(), photo.reduction),
          settings, drawer, *rooms_[std::size_t(drawer)], own(drawer)};
}

// What other processes and this one exchange of some photos.
std::vector<PhotoUnderWay> RankSteps::under_way(const RankedStep& step,
                                                const std::vector<DrawnPhoto>& drawn,
                                                const std::vector<PhotoRows>& rows) {
  std::vector<PhotoUnderWay> all;
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    const DrawnPhoto& photo = drawn[i];
    const bool has_sums = photo.settings.fragment_statistic != FragmentStatistic::none &&
                          !sums_among_gradients(photo.settings);
    const bool is_fixed = photo.settings.deterministic;
    all.push_back({photo.drawer, rows[i], has_sums && !is_fixed ? rows[i].fragment_sums : nullptr,
                   has_sums && is_fixed ? rows[i].fixed_fragment_sums : nullptr,
                   photometric_->is_on()
                       ? photometric_->row_of(model_->photometric, step.photometric, photo.index,
                                              step.batch.size())
                       : Span<double>{},
                   steps_.reports().of_step(photo.number), photo.number});
  }
  return all;
}

// What a rank launches from now on comes after all that was launched on the others.
void RankSteps::wait_for_others(const Rank& rank) const {
  for (const std::unique_ptr<Rank>& other : ranks_) {
    other->has_drawn.hold_back(rank.context);
    other->has_pulled_back.hold_back(rank.context);
  }
}

// A photo, by its rank, once all ranks have projected their rows.
void RankSteps::draw(const RankedStep& step, const DrawnPhoto& drawn) {
  Rank& rank = *drawn.rank;
  CudaRenderer& renderer = drawn.room.renderer;
  RenderPass& pass = drawn.room.pass;
  const OnDevice here(rank.context.device());
  for (const std::unique_ptr<Rank>& other : ranks_) other->has_projected.hold_back(rank.context);
  renderer.finish_projected(drawn.settings, pass,
                            steps_.forecast().capacity_for(drawn.photo, deal_.rows),
                            steps_.reports().of_step(drawn.number), drawn.number);
  LossSettings loss_settings = step.loss_settings;
  loss_settings.photo_reduction = drawn.photo.reduction;
  std::optional<PhotoOnDevice> on_device;
  if (photometric_->is_on()) {
    on_device = photometric_->photo(model_->photometric, step.photometric, drawn.photo, drawn.index,
                                    step.batch.size());
    loss_settings.photo_on_device = &*on_device;
  }
  rank.loss->forward_backward(pass, *drawn.photo.view, loss_settings, rank.dL_dimage);
  blend_backward(rank.context, drawn.settings, rank.dL_dimage.span(), renderer.workspace(), pass);
  rank.has_drawn.set();
}

void RankSteps::clear_failed_step() {
  for (PhotoRoom* const room : rooms_) room->clear_gradients();
  photometric_->clear_gradients();
}

void RankSteps::clear_halted_steps() {
  for (const std::unique_ptr<Rank>& rank : ranks_)
    rank->room.renderer.workspace().halted.fill_zero();
  photometric_->clear_gradients();
  streams_.synchronize();  // before one rank sees the flag of another
}

void RankSteps::keep_watch() {
  const auto now = std::chrono::steady_clock::now();
  if (!watch_ || now - last_watch_ < kBetweenWatches) return;
  last_watch_ = now;
  watch_();
}

}  // namespace gs::cuda
