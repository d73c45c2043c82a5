//! One of the objects that a run knows by their learned codes, as a field of its own.

use burn::tensor::Device;
use dvr_model::{EncoderConfig, ObjectField};

use crate::error::{Error, Result};
use crate::methods::field_model::FieldModel;
use crate::methods::trained_model::TrainedModel;
use crate::objects::object_model::ObjectModel;
use crate::run::checkpoint::Checkpoint;

/// The field of one of the objects, counted from 0, that a run knows by their codes.
///
/// # Errors
/// When the run knows no objects by codes, or not so many; when its model is damaged.
pub fn load_object(checkpoint: &Checkpoint, object: usize, device: &Device) -> Result<Box<dyn TrainedModel>> {
    let model = match ObjectModel::load(checkpoint, device) {
        Err(Error::OneScene) => return Err(Error::NoCodes),
        loaded => loaded?,
    };
    let EncoderConfig::Codes { objects } = *model.encoder() else { return Err(Error::NoCodes) };
    if object >= objects {
        return Err(Error::NoSuchObject { object, objects });
    }
    match model {
        ObjectModel::Fields(model) => Ok(model_of_field(model.field_of_row(object))),
        ObjectModel::System(model) => Err(Error::NoField { method: model.config().system.name().to_owned() }),
    }
}

/// A network that is bound to an object.
pub(crate) fn model_of_field(field: ObjectField) -> Box<dyn TrainedModel> {
    use burn::module::Module;
    let parameters = field.conditioned().decoder().num_params();
    Box::new(FieldModel::new(field, parameters, None))
}
